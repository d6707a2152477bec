"""A simulated LUST CDD3000 behind its frames: what the real one does, as far as it is known.

It logs on until addressed, stores control words until System Start, follows the DRIVECOM machine, answers
parameters, watches its master (574-CAWDG), the ends of its stroke and its following error, and moves the
plant. What it does follows drives/lust_cdd3000/drive.toml and the user manual CM-CAN1 (5-2, 7-4) [F]; stop
reactions (hold at full force, then power off) are [M]. Pure: told the time, it gives frames and instants.
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
from hil.drives.lust_cdd3000.scales import Scales
from hil.drives.meaning import SetpointKind
from hil.drives.power import FAULTED, PowerCommand, PowerState, respond
from hil.drives.profile import LustProfile
from hil.errors import ProtocolError
from hil.frames import Frame
from hil.sim.lust_parameters import ParameterServer
from hil.sim.plant import Plant
from hil.sim.senses import Senses

Timed = list[tuple[float, Frame]]

COURSE_SLACK_M: Final = 1e-3
"""A drive reset beyond the end of its stroke may move so much further out before it stops again [M]."""
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
        self.power = PowerState.SWITCH_ON_DISABLED
        self.enpo = True
        self.referenced = profile.homing == "absolute"
        self.started = False
        """System Start has been received."""
        self._senses = Senses(rig, i, plant, rng)
        self.parameters = ParameterServer(actuator, i, plant, profile, self._senses.measure)
        self._rig, self._i, self._plant, self._profile = rig, i, plant, profile
        self._scales = Scales(actuator.drive, profile)
        self._now_s = plant.now_s
        self._silent = False
        self._boots_until_s = -math.inf
        self._addressed = False
        self._log_on_s = self._now_s
        self._control = Control()
        self._control_s = self._now_s
        self._watched_s = self._now_s
        self._status_s = self._now_s
        self._busy_until_s = self._now_s
        self._off_s = math.inf
        self._repeats = 0
        self._allowance = 0.0
        self._pending_error: int | None = None

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
        out: Timed = []
        if now_s >= self._off_s:
            self._power_off(PowerState.FAULT)
        if self._watching and now_s >= self._watched_s:
            out += self._watch()
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
        due_s = min(self._off_s, self._watchdog_due_s, self._log_on_due_s, self._status_due_s)
        if self._pending_error is not None:
            due_s = self._now_s
        return min(due_s, self._watched_s) if self._watching else due_s

    @property
    def _watching(self) -> bool:
        return self.power is PowerState.OPERATION_ENABLED

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
            self._obey(self._control)
        elif byte == self._profile.system.stop:
            self.started = self._addressed = False
            self._log_on_s = self._now_s
            self._control = Control()
            if self.power not in FAULTED:
                self._power_off(PowerState.SWITCH_ON_DISABLED)
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
            self._obey(control, reset_edge=edge)
        out = self._watch() if self._watching else []
        if self._profile.timing.status_period == 0.0:
            out.append((self._senses.reply_s(self._now_s), self._status_frame()))
        return out

    def _obey(self, control: Control, *, reset_edge: bool = False) -> None:
        """Follow the DRIVECOM machine; a positioning-mode drive prepares itself."""
        command = control.command
        if self._profile.layout.kind == "posmod" and command is PowerCommand.DISABLE:
            command = PowerCommand.PREPARE
        before = self.power
        after = respond(before, command, reset_edge=reset_edge)
        if not self.enpo and after not in FAULTED:
            after = PowerState.SWITCH_ON_DISABLED
        self._plant.advance(self._now_s)
        if before is PowerState.FAULT and after is not PowerState.FAULT:
            self._allowance = self._senses.beyond_course() + COURSE_SLACK_M
        if before is PowerState.OPERATION_ENABLED and after is not before:
            self._power_off(after)
        elif before is not after:
            self.power = after
            if after is PowerState.OPERATION_ENABLED:
                self._plant.set_mode(
                    self._i, "force" if self.parameters.takes_force else "position"
                )
                self._watched_s = self._now_s
        if self.power is PowerState.OPERATION_ENABLED:
            value = self._scales.setpoint(self._kind, control.reference)
            self._plant.set_setpoint(self._i, value, self._now_s - self._senses.frame_s)

    def _on_request(self, number: int, mode: int, value: int, index: int) -> Timed:
        self._addressed = True
        if self._repeats > 0 or self._now_s < self._busy_until_s:
            self._repeats = max(self._repeats - 1, 0)
            answer = Answer(number, AnswerStatus.REPEAT_ACTION, 0, index)
            return [(self._senses.reply_s(self._now_s), encode_answer(self.frames.answer, answer))]
        self._plant.advance(self._now_s)
        enabled = self.power is PowerState.OPERATION_ENABLED
        given = self.parameters.answer(number, mode, value, enabled=enabled)
        if given is None:
            return []
        self._busy_until_s = at_s = self._senses.reply_s(self._now_s)
        return [(at_s, encode_answer(self.frames.answer, Answer(number, *given, index)))]

    # -- what it watches by itself -------------------------------------------------------------------

    def _watch(self) -> Timed:
        """The ends of the stroke and the following error, once each cycle."""
        self._plant.advance(self._now_s)
        self._watched_s = self._now_s + 1.2 * self._rig.bus.cycle
        beyond = self._senses.beyond_course()
        if beyond == 0.0:
            self._allowance = 0.0
        elif beyond > self._allowance:
            return self._trip(self._profile.code_of("course_limitation"))
        if self._kind == "position":
            reference = self._scales.setpoint("position", self._control.reference)
            error = abs(reference - self._plant.position(self._i))
            if error > self._profile.supervision.following_error:
                return self._trip(self._profile.code_of("following_error"))
        return []

    def _trip(self, code: int) -> Timed:
        """Error: hold at once where it stands, power off after the quick stop; the error frame goes out."""
        if self.power in FAULTED:
            return []
        self._plant.advance(self._now_s)
        if self.power is PowerState.OPERATION_ENABLED:
            self._plant.set_mode(self._i, "position")
            self.power = PowerState.FAULT_REACTION
            self._off_s = self._now_s + self._profile.supervision.quick_stop
        else:
            self._power_off(PowerState.FAULT)
        frame = encode_error(self.frames.error, self._profile.error_frame, code, 0, 0)
        return [(self._now_s, frame)]

    def _power_off(self, state: PowerState) -> None:
        self._plant.advance(self._now_s)
        self._plant.set_mode(self._i, "off")
        self._off_s = math.inf
        self.power = state

    # -- what it says --------------------------------------------------------------------------------

    @property
    def _kind(self) -> SetpointKind:
        return "force" if self.parameters.takes_force else "position"

    def _status_frame(self) -> Frame:
        self._status_s = self._now_s
        self._plant.advance(self._now_s)
        layout = self._profile.layout
        if layout.status_carries_position:
            actual = self._scales.reference("position", self._plant.position(self._i))
        else:
            speed = self._profile.parameters.measurements.velocity.scale
            actual = clamp_int32(self._plant.velocity(self._i) / speed)
        automatic = self._control.automatic and self.power is PowerState.OPERATION_ENABLED
        status = Status(self.power, self.enpo, self.referenced, automatic, actual)
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
        self.enpo = present
        if not present:
            self._control = Control()
            faulted = self.power in FAULTED
            self._power_off(PowerState.FAULT if faulted else PowerState.SWITCH_ON_DISABLED)

    def home(self) -> None:
        """It has found its reference."""
        self.referenced = True

    def reboot(self, now_s: float) -> None:
        """It loses its supply and starts again: all that was written is gone."""
        self._now_s = now_s
        self._power_off(PowerState.SWITCH_ON_DISABLED)
        self.parameters.restart()
        self.started = self._addressed = False
        self.referenced = self._profile.homing == "absolute"
        self._control = Control()
        self._repeats = 0
        self._log_on_s = self._boots_until_s = now_s + BOOT_S
