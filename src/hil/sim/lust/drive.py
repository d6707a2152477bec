"""A simulated LUST CDD3000 behind its frames: what the real one does, as far as it is known.

It logs on until addressed, stores control words until System Start, hands them to its power stage
(`lust_power`), answers parameters, watches its master (574-CAWDG) and tells its status. What it does follows
drives/lust_cdd3000/drive.toml and the user manual CM-CAN1 (5-2, 7-4) [F]. Pure: told the time, it gives
frames and instants.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from hil.config import RigFile
from hil.drives.lust_cdd3000.codec import (
    Answer,
    AnswerStatus,
    Control,
    Status,
    clamp_int32,
    decode_control,
    decode_request,
    decode_system,
    encode_answer,
    encode_error,
    encode_status,
    frame_ids,
)
from hil.drives.power import FAULTED, PowerCommand, PowerState
from hil.drives.profile import LustProfile
from hil.errors import ProtocolError
from hil.frames import Frame
from hil.sim.lust.parameters import ParameterServer
from hil.sim.lust.power import PowerStage
from hil.sim.plant import Plant
from hil.sim.senses import Senses

Timed = list[tuple[float, Frame]]

BOOT_S: Final = 0.5
"""From power-on to the first log-on [M]."""


class SimulatedCdd3000:
    """Drive `i` of a rig. The `set_fault`, `silence`, `repeat`, `reboot` and `set_enpo` calls break it."""

    def __init__(
        self, rig: RigFile, i: int, plant: Plant, profile: LustProfile, rng: np.random.Generator
    ) -> None:
        actuator = rig.actuators[i]
        self.name = actuator.name
        self.frames = frame_ids(profile.ids, rig.address(i))
        self.referenced = profile.homing == "absolute"
        self.started = False
        """System Start has been received."""
        self._senses = Senses(rig, i, plant, rng)
        self.parameters = ParameterServer(actuator, i, plant, profile, self._senses.measure)
        self.stage = PowerStage(rig, i, plant, profile, self._senses, self.parameters)
        self._i, self._plant, self._profile = i, plant, profile
        self._now_s = plant.now_s
        self._silent = False
        self._boots_until_s = -math.inf
        self._addressed = False
        self._log_on_s = self._now_s
        self._control = Control()
        self._control_s = self._now_s
        self._status_s = self._now_s
        self._busy_until_s = self._now_s
        self._repeats = 0
        self._pending_error: int | None = None

    @property
    def power(self) -> PowerState:
        """Where it stands in the DRIVECOM machine."""
        return self.stage.state

    # -- frames and time -----------------------------------------------------------------------------

    def on_frame(self, now_s: float, frame: Frame) -> Timed:
        """A frame reaches the drive at `now_s`; frames to others and garbage do nothing."""
        if (
            self._silent
            or now_s < self._boots_until_s
            or frame.is_remote
            or frame.is_extended
            or frame.is_error
        ):
            return []
        self._now_s = now_s
        try:
            if frame.can_id == self._profile.ids.system:
                return self._on_system(decode_system(frame.data))
            if frame.can_id == self.frames.control:
                return self._on_control(decode_control(self._profile.layout, frame.data))
            if frame.can_id == self.frames.request:
                return self._on_request(*decode_request(frame.data))
        except ProtocolError:
            return []
        return []

    def on_time(self, now_s: float) -> Timed:
        """What the drive does by itself up to `now_s`."""
        self._now_s = now_s
        out: Timed = self._trip(self.stage.on_time(now_s))
        if now_s >= self._watchdog_due_s:
            out += self._trip(self._profile.code_of("watchdog"))
        if self._pending_error is not None:
            code, self._pending_error = self._pending_error, None
            out += self._trip(code)
        if now_s >= self._log_on_due_s:
            self._log_on_s = now_s + self._profile.timing.log_on_period
            out.append((now_s, Frame(self.frames.log_on)))
        if now_s >= self._status_due_s:
            out.append((now_s, self._status_frame()))
        return [] if self._silent else out

    @property
    def next_due_s(self) -> float:
        """When `on_time` has something to do, s."""
        if self._pending_error is not None:
            return min(self._now_s, self.stage.due_s)
        return min(self.stage.due_s, self._watchdog_due_s, self._log_on_due_s, self._status_due_s)

    @property
    def _watchdog_due_s(self) -> float:
        limit_s = self.parameters.watchdog_s
        if not self.started or limit_s == 0.0 or self.power in FAULTED:
            return math.inf
        return self._control_s + limit_s

    @property
    def _log_on_due_s(self) -> float:
        return math.inf if self._addressed or self.started else self._log_on_s

    @property
    def _status_due_s(self) -> float:
        period_s = self._profile.timing.status_period
        return self._status_s + period_s if period_s > 0.0 and self._addressed else math.inf

    # -- what the master says ------------------------------------------------------------------------

    def _on_system(self, byte: int) -> Timed:
        if byte == self._profile.system.start:
            self.started = True
            self._control_s = self._now_s
            self.stage.obey(self._now_s, self._control)
        elif byte == self._profile.system.stop:
            self.started = self._addressed = False
            self._log_on_s = self._now_s
            self._control = Control()
            if self.power not in FAULTED:
                self.stage.switch_off(self._now_s, PowerState.SWITCH_ON_DISABLED)
        return []

    def _on_control(self, control: Control) -> Timed:
        self._addressed = True
        self._control_s = self._now_s
        edge = (
            control.command is PowerCommand.RESET
            and self._control.command is not PowerCommand.RESET
        )
        self._control = control
        if self.started:
            self.stage.obey(self._now_s, control, reset_edge=edge)
        out = self._trip(self.stage.watch(self._now_s))
        if self._profile.timing.status_period == 0.0:
            out.append((self._senses.reply_s(self._now_s), self._status_frame()))
        return out

    def _on_request(self, number: int, mode: int, value: int, index: int) -> Timed:
        self._addressed = True
        if self._repeats > 0 or self._now_s < self._busy_until_s:
            self._repeats = max(self._repeats - 1, 0)
            answer = Answer(number, AnswerStatus.REPEAT_ACTION, 0, index)
            return [(self._senses.reply_s(self._now_s), encode_answer(self.frames.answer, answer))]
        self._plant.advance(self._now_s)
        given = self.parameters.answer(number, mode, value, enabled=self.stage.is_on)
        if given is None:
            return []
        self._busy_until_s = at_s = self._senses.reply_s(self._now_s)
        return [(at_s, encode_answer(self.frames.answer, Answer(number, *given, index)))]

    def _trip(self, code: int | None) -> Timed:
        """The error frame of an error that was found, unless it is in fault already."""
        if code is None or not self.stage.trip(self._now_s):
            return []
        frame = encode_error(self.frames.error, self._profile.error_frame, code, 0, 0)
        return [(self._now_s, frame)]

    # -- what it says --------------------------------------------------------------------------------

    def _status_frame(self) -> Frame:
        self._status_s = self._now_s
        self._plant.advance(self._now_s)
        layout = self._profile.layout
        if layout.status_carries_position:
            actual = self.stage.scales.reference("position", self._plant.position(self._i))
        else:
            speed = self._profile.parameters.measurements.velocity.scale
            actual = clamp_int32(self._plant.velocity(self._i) / speed)
        automatic = self._control.automatic and self.stage.is_on
        status = Status(self.power, self.stage.enpo, self.referenced, automatic, actual)
        return encode_status(self.frames.status, layout, status)

    # -- how to break it -----------------------------------------------------------------------------

    def set_fault(self, code: int) -> None:
        """It finds an error by itself at the next instant that it acts."""
        self._pending_error = code

    def silence(self, *, silent: bool = True) -> None:
        """Its bus cable is cut: it hears and says nothing."""
        self._silent = silent

    def repeat(self, count: int) -> None:
        """It answers the next `count` requests "repeat action"."""
        self._repeats = count

    def set_enpo(self, now_s: float, *, present: bool) -> None:
        """The hardware enable comes or goes; without it the motor runs out and control words are cleared."""
        self._now_s = now_s
        self.stage.enpo = present
        if not present:
            self._control = Control()
            off = PowerState.FAULT if self.power in FAULTED else PowerState.SWITCH_ON_DISABLED
            self.stage.switch_off(now_s, off)

    def home(self) -> None:
        """It has found its reference."""
        self.referenced = True

    def reboot(self, now_s: float) -> None:
        """It loses its supply and starts again: all that was written is gone."""
        self._now_s = now_s
        self.stage.switch_off(now_s, PowerState.SWITCH_ON_DISABLED)
        self.parameters.restart()
        self.started = self._addressed = False
        self.referenced = self._profile.homing == "absolute"
        self._control = Control()
        self._repeats = 0
        self._log_on_s = self._boots_until_s = now_s + BOOT_S
