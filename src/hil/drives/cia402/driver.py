"""The master's side of one CiA 402 drive: process data and SDO each slot, by what the drive has said.

A drive is found by its boot-up message or heartbeat, or by asking; it is put into pre-operational, checked
and configured over SDO, started, and from then on told a target in each cycle. Its values hold for the SYNC
that asked for them, so samples carry that instant. What it says is read in `hil.drives.cia402.hearing`.
"""

from __future__ import annotations

from typing import Final

from hil.config import RigFile
from hil.drives.cia402 import codec
from hil.drives.cia402.configure import Boot, wanted_of
from hil.drives.cia402.hearing import NOTHING_SAID, Hearing, Said
from hil.drives.cia402.mapping import KIND_OF, candidates, rpdo
from hil.drives.cia402.meaning import INTERPOLATE, NUMBERS, number_of
from hil.drives.cia402.profile import Cia402Profile
from hil.drives.cia402.sdo import SdoClient, Transfer
from hil.drives.cia402.search import Search
from hil.drives.cia402.targets import Targets
from hil.drives.driver import DrivePhase, DriveStatus, PowerGoal
from hil.drives.enquiry import Enquiry
from hil.drives.meaning import SetpointKind
from hil.drives.phase_inputs import PhaseSettings
from hil.drives.phases import PhaseMachine
from hil.drives.power import FORCEFUL, PowerCommand, PowerState
from hil.frames import Frame
from hil.signals import Event, Sample

OURS: Final = (0x1005, 0x1006, 0x6060, 0x607C)
"""SYNC's identifier and period, mode of operation, home offset: what else nobody changes beside us."""
ENABLE: Final = PowerCommand.ENABLE.value
SWITCH_ON: Final = PowerCommand.SWITCH_ON.value


class Cia402Driver:
    """One drive of a rig. Its phases are told in `hil.drives.phases`."""

    numbers = NUMBERS

    def __init__(self, rig: RigFile, i: int, profile: Cia402Profile) -> None:
        actuator, node = rig.actuators[i], rig.address(i)
        self.name = actuator.name
        self.frames = codec.node_ids(node)
        mode = candidates(rig, actuator)[0]
        self.wire_kind: SetpointKind = KIND_OF[mode]
        self.setpoint_kind: SetpointKind = "force" if self.wire_kind == "force" else "position"
        self.sdo = SdoClient(profile.timing.sdo_timeout, profile.timing.sdo_tries)
        self._off_timeout_s = profile.timing.off_timeout
        self._node = node
        self._layout = rpdo(mode)
        wanted = wanted_of(rig, i, profile, self.frames)
        self._boot = Boot(wanted)
        self._held = frozenset(
            {number_of(index, sub) for index, sub, _, _ in wanted.settings}
            | {number_of(*key) for key in profile.objects.entries if 0x1400 <= key[0] < 0x1C00}
            | {number_of(index, 0) for index in OURS}
        )
        self._enquiries: list[tuple[Enquiry, Transfer]] = []
        self._machine: PhaseMachine[Said] = PhaseMachine(
            f"{self.name} (node {node})",
            _phase_settings(profile),
            NOTHING_SAID,
            self._boot,
            {"position", "force"},
            rig.safety.answer_timeout,
        )
        self._ids = frozenset(
            {self.frames.emcy, self.frames.tpdo, self.frames.sdo_answer, self.frames.heartbeat}
        )
        self._hearing = Hearing(
            rig, i, profile, self._machine, self._boot, self.sdo, self._found_anew
        )
        self._targets = Targets(rig, i, self.wire_kind)
        self._search = Search(self.frames, profile.timing)
        self._is_put = False  # told to be pre-operational since it was found
        self.is_homing = False
        """Bit 4 of the control word is set: the drive, in its homing mode, searches its zero."""

    @property
    def status(self) -> DriveStatus:
        """The drive as known now."""
        machine, hearing = self._machine, self._hearing
        return DriveStatus(  # by place: it is made for each drive in each cycle
            machine.phase,
            machine.phase is DrivePhase.ENABLED,
            machine.referenced,
            machine.status.enpo,
            machine.error,
            machine.waiting_for(),
            machine.heard_s,
            self._boot.watchdog_ok,
            hearing.slots,
            hearing.pairs,
            0,
            self.sdo.timeouts,
            hearing.garbage,
            self.sdo.unasked,
        )

    @property
    def word(self) -> int:
        """Last status word."""
        return self._hearing.word

    @property
    def phase(self) -> DrivePhase:
        """How far the drive has come."""
        return self._machine.phase

    @property
    def started(self) -> bool:
        """It was told to be operational since it was found.

        After a boot-up message in mid-run it is told to be off all the same: another node may have been set
        to its number, or it has begun its communication anew and not its power stage.
        """
        return self._hearing.is_mapped

    def is_deaf(self, now_s: float) -> bool:
        """It is there, and has long been told to be off, but what it said last is that it makes force.

        Its process data do not reach it, or it has no SYNC; what it still hears is our heartbeat.
        """
        machine = self._machine
        is_on = machine.status.power in FORCEFUL
        is_told_off = machine.told_off_for(now_s) > self._off_timeout_s
        return is_on and is_told_off and self._hearing.watch.is_heard(now_s)

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
        machine = self._machine
        said: list[Sample | Event] = []
        if is_remote:
            self._hearing.garbage += 1
        else:
            said = self._hearing.on_frame(now_s, can_id, data)
        if machine.phase is DrivePhase.ABSENT:
            self._search.heard()
        machine.judge(now_s)
        if machine.events:
            said += self.take_events()
        return said

    # -- frames out ----------------------------------------------------------------------------------

    def on_sync(self, now_s: float) -> None:
        """SYNC goes out now."""
        self._hearing.syncs.sent(now_s)

    def on_slot(self, now_s: float, goal: PowerGoal, setpoint: float | None) -> list[Frame]:
        """Process data where the drive is operational, and at most one SDO request or NMT command."""
        machine = self._machine
        if self._enquiries:
            self._settle()
        machine.wants(now_s, goal)
        if machine.started:
            self._watch(now_s)
        elif machine.resetting:
            # No process data, so no reset bit: it is looked for and configured anew.
            machine.absent(now_s)
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
        frames = self._values_out(now_s, setpoint)
        frames += self._one_more(now_s)
        return frames

    def _watch(self, now_s: float) -> None:
        if self._machine.phase is DrivePhase.ABSENT or self._machine.phase is DrivePhase.FAULT:
            return
        trouble = self._hearing.watch.trouble(now_s)
        if trouble is not None:
            self._machine.fault(now_s, *trouble)

    def _settle(self) -> None:
        """Hand on what transfers brought; one whose enquirer has given up is not done later all the same."""
        for enquiry, transfer in self._enquiries:
            if enquiry.is_done:
                self.sdo.withdraw(transfer)
            elif transfer.error is not None:
                enquiry.failed(str(transfer.error))
            elif transfer.is_done:
                enquiry.answered(transfer.result)
        self._enquiries = [e for e in self._enquiries if not e[0].is_done]

    def _look_for(self, now_s: float) -> list[Frame]:
        """Ask who is there, once we have listened; a drive that says anything is found."""
        if not self._search.found(now_s):
            return self._search.ask(now_s)
        if self._machine.log_on(now_s):
            self._found_anew()
        return []

    def _found_anew(self) -> None:
        self.sdo.reset()
        self._is_put = False
        self._targets.restart()
        self._hearing.anew()

    def _values_out(self, now_s: float, setpoint: float | None) -> list[Frame]:
        machine, hearing = self._machine, self._hearing
        if not hearing.is_mapped:
            return []
        hearing.slots += 1
        command = machine.command(now_s)
        if command is not PowerCommand.ENABLE:
            word, target = command.value, self._targets.idle(hearing.position)
        else:
            word, target = ENABLE, self._targets.of(setpoint, hearing.position)
            if machine.status.power is PowerState.READY_TO_SWITCH_ON:
                word = SWITCH_ON
            elif self._boot.mode == "ip" or self.is_homing:
                word |= INTERPOLATE
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
            self._hearing.is_mapped = True
            self._hearing.watch.started(now_s)
            return [self._nmt_frame(codec.NmtCommand.START)]
        request = self.sdo.next_request(now_s)
        return [] if request is None else [Frame(self.frames.sdo_request, request)]

    def _nmt_frame(self, command: codec.NmtCommand) -> Frame:
        return Frame(codec.NMT_ID, codec.encode_nmt(command, self._node))


def _phase_settings(profile: Cia402Profile) -> PhaseSettings:
    timing = profile.timing
    return PhaseSettings(
        repeat_s=0.0,
        status_timeout_s=timing.status_timeout,
        enable_timeout_s=timing.enable_timeout,
        off_timeout_s=timing.off_timeout,
        reset_hold_s=timing.reset_hold,
        absolute=profile.homing.kind == "absolute",
        absent="has not been heard: is it powered, on this bus, at this bit rate, and set to this node?",
        unstarted="is about to be started",
        enable_input="voltage (status bit 4)",
        tells_unstarted=False,
    )
