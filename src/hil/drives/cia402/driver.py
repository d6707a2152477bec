"""The master's side of one CiA 402 drive: frames in, samples and events out; process data and SDO each slot.

A drive is found by its boot-up message or heartbeat, or by asking; it is put into pre-operational, checked
and configured over SDO, started, and from then on told a target in each cycle. Its values hold for the SYNC
that asked for them, so samples carry that instant.
"""

from __future__ import annotations

import math
from collections import deque
from typing import Final, NamedTuple

from hil.config import RigFile
from hil.drives.cia402 import codec
from hil.drives.cia402.configure import Boot, wanted_of
from hil.drives.cia402.mapping import KIND_OF, TPDO, Units, candidates, rpdo
from hil.drives.cia402.meaning import INTERPOLATE, number_of
from hil.drives.cia402.profile import Cia402Profile
from hil.drives.cia402.sdo import SdoClient, Transfer
from hil.drives.cia402.targets import Syncs, Targets
from hil.drives.driver import DrivePhase, DriveStatus, PowerGoal
from hil.drives.enquiry import Enquiry
from hil.drives.meaning import SetpointKind
from hil.drives.phases import PhaseMachine, PhaseSettings
from hil.drives.power import VOLTAGE_ENABLED, PowerCommand, PowerState, decode_status_word
from hil.errors import ProtocolError
from hil.frames import Frame
from hil.signals import Event, Sample

STORM: Final = 20
"""Emergency messages in a second that are a storm."""
SETTLE_S: Final = 0.3
"""A node that was started gets so long until its heartbeat says so."""
OURS: Final = (0x1005, 0x1006, 0x6060, 0x607C)
"""SYNC's identifier and period, mode of operation, home offset: what else nobody changes beside us."""
COURSE_CODES: Final = frozenset({0x8612})


class _Said(NamedTuple):
    """What a drive's status word says."""

    power: PowerState
    enpo: bool
    referenced: bool


class Cia402Driver:
    """One drive of a rig. Its phases are told in `hil.drives.phases`."""

    def __init__(self, rig: RigFile, i: int, profile: Cia402Profile) -> None:
        actuator, node = rig.actuators[i], rig.address(i)
        self.name = actuator.name
        self.frames = codec.node_ids(node)
        mode = candidates(rig, actuator)[0]
        self.wire_kind: SetpointKind = KIND_OF[mode]
        self.setpoint_kind: SetpointKind = "force" if self.wire_kind == "force" else "position"
        self.sdo = SdoClient(profile.timing.sdo_timeout, profile.timing.sdo_tries)
        self._node, self._profile = node, profile
        self._layout, self._units = rpdo(mode), Units(actuator)
        wanted = wanted_of(rig, i, profile, self.frames)
        self._boot = Boot(wanted)
        self._held = frozenset(
            {number_of(index, sub) for index, sub, _, _ in wanted.settings}
            | {number_of(*key) for key in profile.objects.entries if 0x1400 <= key[0] < 0x1C00}
            | {number_of(index, 0) for index in OURS}
        )
        self._enquiries: list[tuple[Enquiry, Transfer]] = []
        self._machine = PhaseMachine(
            f"{self.name} (node {node})",
            _phase_settings(profile),
            _Said(PowerState.NOT_READY, False, False),
            self._boot,
            {"position", "force"},
            rig.safety.answer_timeout,
        )
        self._ids = frozenset(
            {self.frames.emcy, self.frames.tpdo, self.frames.sdo_answer, self.frames.heartbeat}
        )
        self._targets = Targets(rig, i, self.wire_kind)
        self._syncs = Syncs(rig, i)
        self._first_slot_s: float | None = None
        self._asked_s = -math.inf
        self._heard_now = False
        self._is_put = False  # told to be pre-operational since it was found
        self._started_s = 0.0
        self._heartbeat_s = 0.0
        self._nmt: codec.NmtState | None = None
        self.word = 0
        """Last status word."""
        self.is_homing = False
        """Bit 4 of the control word is set: the drive, in its homing mode, searches its zero."""
        self._emergencies: deque[float] = deque(maxlen=STORM)
        self._stormed_s = -math.inf
        self._wrong = self._garbage = self._slots = self._pairs = 0

    @property
    def status(self) -> DriveStatus:
        """The drive as known now."""
        machine = self._machine
        return DriveStatus(
            phase=machine.phase,
            enabled=machine.phase is DrivePhase.ENABLED,
            referenced=machine.referenced,
            enpo=machine.status.enpo,
            error=machine.error,
            waiting_for=machine.waiting_for(),
            last_answer_s=machine.heard_s,
            watchdog_ok=self._boot.watchdog_ok,
            slots=self._slots,
            pairs=self._pairs,
            repeats=0,
            timeouts=self.sdo.timeouts,
            garbage=self._garbage,
            unasked=self.sdo.unasked,
        )

    @property
    def phase(self) -> DrivePhase:
        """How far the drive has come."""
        return self._machine.phase

    @property
    def started(self) -> bool:
        """It was told to be operational since it was found."""
        return self._machine.started

    @property
    def boot(self) -> Boot:
        """What its configuration found."""
        return self._boot

    @property
    def held(self) -> frozenset[int]:
        """Numbers of the objects that configuration writes, of PDO parameters, of SYNC, of the zero."""
        return self._held

    def enquire(self, enquiry: Enquiry) -> None:
        """Read or write an object besides; it has its turn on the one channel there is."""
        index, sub = enquiry.number >> 8, enquiry.number & 0xFF
        self._enquiries.append((enquiry, self.sdo.submit(Transfer(index, sub, enquiry.data))))

    def ids(self) -> frozenset[int]:
        """This drive's frames."""
        return self._ids

    def take_events(self) -> list[Event]:
        """Events not handed out yet."""
        events, self._machine.events = self._machine.events, []
        return events

    # -- frames in -----------------------------------------------------------------------------------

    def on_frame(self, now_s: float, frame: Frame) -> list[Sample | Event]:
        """Take a frame received at `now_s`; frames of others are left alone, garbage is counted."""
        can_id, data, is_extended, is_remote, is_error, _ = frame
        if is_error or is_extended or can_id not in self._ids:
            return []
        samples: list[Sample | Event] = []
        machine = self._machine
        if is_remote:
            self._garbage += 1
        elif can_id == self.frames.tpdo:
            samples = self._on_values(now_s, data)
        elif can_id == self.frames.sdo_answer:
            if machine.phase is not DrivePhase.ABSENT:
                machine.answered(now_s, None)
                self.sdo.on_answer(data)
        elif can_id == self.frames.emcy:
            self._on_emergency(now_s, data)
        else:
            self._on_heartbeat(now_s, data)
        if machine.phase is DrivePhase.ABSENT:
            self._heard_now = True
        machine.judge(now_s)
        return [*samples, *self.take_events()] if machine.events else samples

    def _on_values(self, now_s: float, data: bytes) -> list[Sample | Event]:
        try:
            word, position, torque = TPDO.unpack(data)
            power = decode_status_word(word)
        except ProtocolError as error:
            self._garbage += 1
            self._wrong += 1
            if self._wrong >= self._profile.supervision.wrong_pdos and self._machine.started:
                self._machine.fault(now_s, "wrong_pdo", f"sends what is not mapped: {error}")
            return []
        self._wrong = 0
        machine, units = self._machine, self._units
        if machine.phase is DrivePhase.ABSENT or not machine.started:
            return []  # of an earlier master's making: nobody knows what is mapped
        self._pairs = min(self._pairs + 1, self._slots)
        self._targets.position, self.word = position, word
        machine.took_status(
            now_s, _Said(power, bool(word & VOLTAGE_ENABLED), self._boot.is_referenced)
        )
        machine.answered(now_s, "position")
        machine.answered(now_s, "force")
        at_s = self._syncs.answered(now_s)
        return [
            Sample(self.name, "position", units.measured("position", position), at_s, now_s),
            Sample(self.name, "force", units.measured("force", torque), at_s, now_s),
        ]

    def _on_emergency(self, now_s: float, data: bytes) -> None:
        """An emergency is one whatever its length: of all frames this one is never ignored."""
        machine = self._machine
        machine.heard_s = now_s
        self._tell_storm(now_s)
        emergency = codec.decode_emcy(data)
        if emergency.code == 0:
            return
        name = "course_limitation" if emergency.code in COURSE_CODES else "drive_error"
        machine.fault(now_s, name, f"reports {self._profile.error_text(emergency.code)}")

    def _tell_storm(self, now_s: float) -> None:
        times = self._emergencies
        times.append(now_s)
        is_storm = len(times) == STORM and now_s - times[0] < 1.0
        if is_storm and now_s - self._stormed_s > 1.0:
            self._stormed_s = now_s
            text = f"{self.name} (node {self._node}) sends emergency messages in a storm: look at its display"
            self._machine.events.append(Event(now_s, "warning", "emcy_storm", text))

    def _on_heartbeat(self, now_s: float, data: bytes) -> None:
        try:
            state = codec.decode_heartbeat(data)
        except ProtocolError:
            self._garbage += 1
            return
        machine = self._machine
        self._heartbeat_s, self._nmt = now_s, state
        if state is codec.NmtState.BOOT_UP and machine.phase is not DrivePhase.ABSENT:
            if machine.log_on(now_s):
                self._found_anew()
        elif not machine.started:
            machine.heard_s = now_s

    # -- frames out ----------------------------------------------------------------------------------

    def on_sync(self, now_s: float) -> None:
        """SYNC goes out now."""
        self._syncs.sent(now_s)

    def on_slot(self, now_s: float, goal: PowerGoal, setpoint: float | None) -> list[Frame]:
        """Process data where the drive is operational, and at most one SDO request or NMT command."""
        if self._first_slot_s is None:
            self._first_slot_s = now_s
        machine = self._machine
        if self._enquiries:
            self._settle()
        machine.wants(now_s, goal)
        if machine.resetting and not machine.started:
            machine.absent(
                now_s
            )  # no process data, so no reset bit: it is looked for and configured anew
        self._watch(now_s)
        if machine.phase is DrivePhase.LOGGED_ON and self._is_put and self.sdo.is_idle:
            transfer = self._boot.next_transfer()
            if transfer is not None:
                self.sdo.submit(transfer)
        was_absent = machine.phase is DrivePhase.ABSENT
        machine.judge(now_s)
        if machine.phase is DrivePhase.ABSENT:
            if not was_absent:
                self._found_anew()
            return self._look_for(now_s)
        if machine.muted:
            return []
        frames = self._values_out(now_s, setpoint)
        frames += self._one_more(now_s)
        return frames

    def _settle(self) -> None:
        for enquiry, transfer in self._enquiries:
            if transfer.error is not None:
                enquiry.failed(str(transfer.error))
            elif transfer.is_done:
                enquiry.answered(transfer.result)
        self._enquiries = [e for e in self._enquiries if not e[1].is_done]

    def refuse(self, now_s: float, name: str, text: str) -> None:
        """Latch a fault of the bus as a whole, and say nothing to the drive until it is reset."""
        self._machine.muted = True
        self._machine.fault(now_s, name, text)

    def _look_for(self, now_s: float) -> list[Frame]:
        """Ask who is there, once we have listened; a drive that says anything is found."""
        first_s = self._first_slot_s
        if first_s is None or now_s - first_s < self._profile.timing.listen:
            return []
        if self._heard_now:
            self._heard_now = False
            if self._machine.log_on(now_s):
                self._found_anew()
            return []
        if now_s - self._asked_s < self._profile.timing.poll:
            return []
        self._asked_s = now_s
        return [Frame(self.frames.sdo_request, Transfer(0x1000, 0).request)]

    def _found_anew(self) -> None:
        self.sdo.reset()
        self._is_put = False
        self._targets.restart()
        self._wrong = 0

    def _values_out(self, now_s: float, setpoint: float | None) -> list[Frame]:
        machine = self._machine
        if not machine.started:
            return []
        self._slots += 1
        command = machine.command(now_s)
        word = command.value
        if machine.phase is DrivePhase.FAULT or command is not PowerCommand.ENABLE:
            target = self._targets.idle()
        else:
            if machine.status.power is PowerState.READY_TO_SWITCH_ON:
                word = PowerCommand.SWITCH_ON.value
            elif self._boot.mode == "ip" or self.is_homing:
                word |= INTERPOLATE
            target = self._targets.of(setpoint)
        return [Frame(self.frames.rpdo, self._layout.pack(word, round(target)))]

    def _one_more(self, now_s: float) -> list[Frame]:
        """An NMT command where one is due, else an SDO request where one waits."""
        machine = self._machine
        if machine.phase is DrivePhase.LOGGED_ON and not self._is_put:
            self._is_put = True
            machine.started = False
            return [self._nmt_frame(codec.NmtCommand.PRE_OPERATIONAL)]
        if machine.phase is DrivePhase.CONFIGURED and not machine.started:
            machine.start(now_s)
            self._started_s = self._heartbeat_s = now_s
            self._nmt = None
            return [self._nmt_frame(codec.NmtCommand.START)]
        request = self.sdo.next_request(now_s)
        return [] if request is None else [Frame(self.frames.sdo_request, request)]

    def _nmt_frame(self, command: codec.NmtCommand) -> Frame:
        return Frame(codec.NMT_ID, codec.encode_nmt(command, self._node))

    def _watch(self, now_s: float) -> None:
        """Its heartbeat, and what it says."""
        machine, watch = self._machine, self._profile.supervision
        if not machine.started or machine.phase in (DrivePhase.ABSENT, DrivePhase.FAULT):
            return
        quiet_s = now_s - self._heartbeat_s
        if quiet_s > watch.heartbeat * (watch.heartbeats_missed + 1):
            machine.fault(now_s, "drive_silent", f"has sent no heartbeat for {quiet_s:.2f} s")
        elif (
            self._nmt is not None
            and self._nmt is not codec.NmtState.OPERATIONAL
            and now_s - self._started_s > SETTLE_S
        ):
            machine.fault(now_s, "drive_left_operational", f"is {self._nmt}, not operational")


def _phase_settings(profile: Cia402Profile) -> PhaseSettings:
    timing = profile.timing
    return PhaseSettings(
        repeat_s=0.0,
        status_timeout_s=timing.status_timeout,
        enable_timeout_s=timing.enable_timeout,
        reset_hold_s=timing.reset_hold,
        absolute=profile.homing.kind == "absolute",
        absent="has not been heard: is it powered, on this bus, at this bit rate, and set to this node?",
        unstarted="is about to be started",
        enable_input="voltage (status bit 4)",
        tells_unstarted=False,
    )
