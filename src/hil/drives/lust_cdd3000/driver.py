"""The master's side of one LUST CDD3000: frames in, samples and events out; control and request each slot.

Positions are increments from the drive's zero, which is the rig file's zero (a leg's length between its
joints, a slide's coordinate). What comes in is checked for length and form, and counted where it is not
what the protocol allows; an answer to a question not asked is counted and never followed.
"""

from __future__ import annotations

import math
from collections import deque
from typing import Final

from hil.config import RigFile
from hil.drives.driver import DrivePhase, DriveStatus, PowerGoal
from hil.drives.enquiry import Enquiry
from hil.drives.lust_cdd3000.channel import ParameterChannel
from hil.drives.lust_cdd3000.codec import (
    NUMBERS,
    Answer,
    Control,
    Status,
    decode_answer,
    decode_error,
    decode_status,
    encode_control,
    encode_request,
    frame_ids,
)
from hil.drives.lust_cdd3000.scales import Scales, kind_of
from hil.drives.meaning import SetpointKind
from hil.drives.phase_inputs import PhaseSettings
from hil.drives.phases import PhaseMachine
from hil.drives.power import PowerCommand, PowerState
from hil.drives.profile import LustProfile
from hil.errors import ProtocolError
from hil.frames import Frame
from hil.signals import Event, Quantity, Sample

UNASKED: Final = 10
"""So many answers in a second to nothing that is asked are told."""
UNASKED_AGAIN_S: Final = 10.0


class LustDriver:
    """One drive of a rig. Its phases are told in `hil.drives.phases`."""

    numbers = NUMBERS

    def __init__(self, rig: RigFile, index: int, profile: LustProfile) -> None:
        actuator = rig.actuators[index]
        address = rig.address(index)
        self.name = actuator.name
        self.setpoint_kind: SetpointKind = kind_of(rig, profile)
        self.wire_kind: SetpointKind = self.setpoint_kind
        self.frames = frame_ids(profile.ids, address)
        self.told = False
        """A control frame has been sent since the drive last logged on."""
        self._profile = profile
        self._scales = Scales(actuator.drive, profile)
        self._answer_delay_s = rig.bus.answer_delay
        self._channel = ParameterChannel(rig, index, profile, self._scales)
        self._machine = PhaseMachine(
            f"{self.name} (address {address})",
            phase_settings(profile),
            Status(PowerState.NOT_READY, enpo=False),
            self._channel.configuration,
            {*rig.bus.pattern, "position"},
            rig.safety.answer_timeout,
        )
        self._ids = frozenset(
            {
                self.frames.log_on,
                self.frames.status,
                self.frames.answer,
                self.frames.error,
                profile.ids.error,
            }
        )
        self._first_slot_s: float | None = None
        self._logged_on = False
        self._reference = 0
        self._garbage = 0
        self._unasked: deque[float] = deque(maxlen=UNASKED)
        self._unasked_told_s = -math.inf

    @property
    def phase(self) -> DrivePhase:
        """How far the drive has come."""
        return self._machine.phase

    @property
    def started(self) -> bool:
        """System Start has been sent since the drive last logged on."""
        return self._machine.started

    @property
    def needs_start(self) -> bool:
        """Its reset waits for System Start: before that the drive stores control words and obeys none."""
        return self._machine.resetting and not self._machine.started

    @property
    def status(self) -> DriveStatus:
        """The drive as known now."""
        machine, slots = self._machine, self._channel.slots
        return DriveStatus(
            phase=machine.phase,
            enabled=machine.phase is DrivePhase.ENABLED,
            referenced=machine.referenced,
            enpo=machine.status.enpo,
            error=machine.error,
            waiting_for=machine.waiting_for(),
            last_answer_s=machine.heard_s,
            watchdog_ok=self._channel.configuration.watchdog_ok,
            slots=slots.slots,
            pairs=slots.pairs,
            repeats=slots.repeats,
            timeouts=slots.timeouts,
            garbage=self._garbage,
            unasked=slots.unasked,
        )

    @property
    def held(self) -> frozenset[int]:
        """Numbers of the parameters that hil itself writes."""
        return self._channel.held

    def enquire(self, enquiry: Enquiry) -> None:
        """Read a parameter besides."""
        self._channel.enquire(enquiry)

    def ids(self) -> frozenset[int]:
        """This drive's frames, and the error identifier without an address, which concerns all drives."""
        return self._ids

    def take_events(self) -> list[Event]:
        """Events not handed out yet."""
        events, self._machine.events = self._machine.events, []
        return events

    def absent_for(self, now_s: float) -> float:
        """How long it has been waited for since our first slot, s; 0 where it has logged on."""
        if self.phase is not DrivePhase.ABSENT or self._first_slot_s is None or self._logged_on:
            return 0.0
        return now_s - self._first_slot_s

    # -- frames in -----------------------------------------------------------------------------------

    def on_frame(self, now_s: float, frame: Frame) -> list[Sample | Event]:
        """Take a frame received at `now_s`; frames of others are left alone, garbage is counted."""
        if frame.is_error or frame.is_extended or frame.can_id not in self._ids:
            return []
        samples: list[Sample] = []
        if frame.is_remote:
            self._garbage += 1
        elif frame.can_id in (self.frames.error, self._profile.ids.error):
            self._on_error(now_s, frame.data)
        elif frame.can_id == self.frames.log_on:
            self._on_log_on(now_s)
        else:
            try:
                if frame.can_id == self.frames.status:
                    status = decode_status(self._profile.layout, frame.data)
                    samples = self._on_status(now_s, status)
                else:
                    samples = self._on_answer(now_s, decode_answer(frame.data))
            except ProtocolError:
                self._garbage += 1
        self._machine.judge(now_s)
        return [*samples, *self.take_events()]

    def _on_error(self, now_s: float, data: bytes) -> None:
        """An error frame is an error whatever its length: of all frames this one is never ignored."""
        self._machine.heard_s = now_s
        report = decode_error(self._profile.error_frame, data)
        name, what = "drive_error", "an error without a number"
        if report.code is not None:
            what = self._profile.error_text(report.code)
            if report.code == self._profile.code_of("course_limitation"):
                name = "course_limitation"
        where = f" at location {report.location}" if report.location else ""
        self._machine.fault(now_s, name, f"reports {what}{where}")

    def _on_log_on(self, now_s: float) -> None:
        if self.phase is DrivePhase.ABSENT and not self._listened(now_s):
            self._logged_on = True  # spoken to once we have listened long enough to know all
            return
        self._take_log_on(now_s)

    def _take_log_on(self, now_s: float) -> None:
        if self._machine.log_on(now_s):
            self.told = False
            self._channel.restart()

    def _on_status(self, now_s: float, status: Status) -> list[Sample]:
        self._machine.took_status(now_s, status)
        if not self._profile.layout.status_carries_position:
            return []
        self._channel.position = status.actual
        self._machine.answered(now_s, "position")
        value = self._scales.setpoint("position", status.actual)
        return [self._sample(now_s, "position", value)]

    def _on_answer(self, now_s: float, answer: Answer) -> list[Sample]:
        taken = self._channel.take(answer)
        self._machine.surplus(now_s, self._channel.slots.surplus)
        if taken is None:
            self._on_unasked(now_s)
            return []
        self._machine.answered(now_s, taken.quantity)
        if taken.refusal is not None:
            self._machine.fault(now_s, "drive_refuses", taken.refusal)
        if taken.quantity is None:
            return []
        return [self._sample(now_s, taken.quantity, taken.value)]

    def _on_unasked(self, now_s: float) -> None:
        """One more; where they go on its answers are late, which no counter tells a person in time."""
        times = self._unasked
        times.append(now_s)
        is_often = len(times) == UNASKED and now_s - times[0] < 1.0
        if not is_often or now_s - self._unasked_told_s < UNASKED_AGAIN_S:
            return
        self._unasked_told_s = now_s
        text = (
            f"{self.name} answers late or twice: {UNASKED} answers within a second to nothing that was asked "
            "then; its positions may be older than their stamps and come in every second slot only. Compare "
            "timing.answer_wait and bus.cycle with what it needs"
        )
        self._machine.events.append(Event(now_s, "warning", "drive_answers_late", text))

    def _sample(self, now_s: float, quantity: Quantity, value: float) -> Sample:
        return Sample(self.name, quantity, value, now_s - self._answer_delay_s, now_s)

    # -- frames out ----------------------------------------------------------------------------------

    def on_slot(self, now_s: float, goal: PowerGoal, setpoint: float | None) -> list[Frame]:
        """The control frame and one parameter request; nothing while we only listen."""
        if self._first_slot_s is None:
            self._first_slot_s = now_s
        machine = self._machine
        was_absent = self.phase is DrivePhase.ABSENT
        machine.wants(now_s, goal)
        machine.judge(now_s)
        if self.phase is DrivePhase.ABSENT and not was_absent:
            self._wait_for_log_on(now_s)
        if self._logged_on and self._listened(now_s):
            self._logged_on = False
            self._take_log_on(now_s)
        if self.phase is DrivePhase.ABSENT or machine.muted or not self._listened(now_s):
            return []
        command = machine.command(now_s)
        control = encode_control(
            self.frames.control, self._profile.layout, self._control(command, setpoint)
        )
        self.told = True
        request = self._channel.ask(now_s, configuring=self.phase is DrivePhase.LOGGED_ON)
        if request is None:
            return [control]
        return [control, encode_request(self.frames.request, request)]

    def _control(self, command: PowerCommand, setpoint: float | None) -> Control:
        if self.phase is DrivePhase.FAULT:
            return Control(command)
        if command is not PowerCommand.ENABLE:
            self._reference = self._idle_reference()
            return Control(command, self._reference)
        if setpoint is not None and math.isfinite(setpoint):
            self._reference = self._scales.reference(self.setpoint_kind, setpoint)
        status = self._machine.status
        return Control(
            command,
            self._reference,
            automatic=status.power is PowerState.OPERATION_ENABLED,
            sequence=status.automatic,
        )

    def _idle_reference(self) -> int:
        """What moves nothing when the power comes: where the drive is, or no force."""
        if self.setpoint_kind == "force" or self._channel.position is None:
            return 0
        return self._channel.position

    def _listened(self, now_s: float) -> bool:
        first_s = self._first_slot_s
        return first_s is not None and now_s - first_s >= self._profile.timing.listen

    # -- told by the bus -----------------------------------------------------------------------------

    def system_started(self) -> None:
        """System Start goes out."""
        self._machine.started = True

    def system_stopped(self, now_s: float) -> None:
        """System Stop goes out: the drive will log on again, and is waited for in silence."""
        self._machine.started = False
        if self.phase is not DrivePhase.FAULT:
            self._machine.absent(now_s)
            self._wait_for_log_on(now_s)

    def refuse(self, now_s: float, name: str, text: str) -> None:
        """Latch a fault of the bus as a whole, and say nothing to the drive until it is reset."""
        self._machine.muted = True
        self._machine.fault(now_s, name, text)

    def _wait_for_log_on(self, now_s: float) -> None:
        self._channel.restart()
        self.told = False
        self._first_slot_s = now_s
        self._logged_on = False


def phase_settings(profile: LustProfile) -> PhaseSettings:
    """Times and words of the family for its phase machine."""
    timing = profile.timing
    return PhaseSettings(
        repeat_s=timing.log_on_period,
        status_timeout_s=timing.status_timeout,
        enable_timeout_s=timing.enable_timeout,
        off_timeout_s=timing.enable_timeout,
        reset_hold_s=timing.reset_hold,
        absolute=profile.homing == "absolute",
        absent="has not logged on: is it powered, on this bus, and set to this address? "
        "A drive that ran before may have to be switched off and on",
        unstarted="waits for the other drives and System Start",
        enable_input="ENPO",
        tells_unstarted=True,
    )
