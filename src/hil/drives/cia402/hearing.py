"""What one node says, each to whom it concerns: values, answers, emergencies, heartbeats."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final, NamedTuple

from hil.config import RigFile
from hil.drives.cia402 import codec
from hil.drives.cia402.configure import Boot
from hil.drives.cia402.mapping import TPDO, Units
from hil.drives.cia402.profile import Cia402Profile
from hil.drives.cia402.sdo import SdoClient
from hil.drives.cia402.targets import Syncs
from hil.drives.cia402.watch import Watch
from hil.drives.driver import DrivePhase
from hil.drives.phases import PhaseMachine
from hil.drives.power import VOLTAGE_ENABLED, PowerState, decode_status_word
from hil.errors import ProtocolError
from hil.signals import Event, Sample

COURSE_CODES: Final = frozenset({0x8612})


class Said(NamedTuple):
    """What a drive's status word says."""

    power: PowerState
    enpo: bool
    referenced: bool


NOTHING_SAID: Final = Said(PowerState.NOT_READY, False, False)


class Hearing:
    """Takes one node's frames. `syncs` and `watch` are told by whoever sends to it."""

    def __init__(
        self,
        rig: RigFile,
        i: int,
        profile: Cia402Profile,
        machine: PhaseMachine[Said],
        boot: Boot,
        sdo: SdoClient,
        restarted: Callable[[], None],
    ) -> None:
        """`restarted` is called where a node that was known begins anew."""
        self._name, self._node = rig.actuators[i].name, rig.address(i)
        self._ids = codec.node_ids(self._node)
        self._units = Units(rig.actuators[i])
        self._profile = profile
        self._machine, self._boot, self._sdo = machine, boot, sdo
        self._restarted = restarted
        self._said = NOTHING_SAID
        self._wrong = 0
        self.is_mapped = False
        """It was started with our mapping since it was found."""
        self.syncs = Syncs(rig, i)
        self.watch = Watch(profile.supervision)
        self.word = 0
        """Last status word."""
        self.position = 0
        """Last position, increments."""
        self.garbage = 0
        """Frames that are not what the protocol allows."""
        self.slots = 0
        """Slots in which values could be asked for, counted by whoever asks."""
        self.pairs = 0
        """Of these, answered."""

    def anew(self) -> None:
        """It begins anew: what it sent wrongly before is forgiven, and what is mapped is not known."""
        self._wrong = 0
        self.is_mapped = False

    def on_frame(self, now_s: float, can_id: int, data: bytes) -> list[Sample | Event]:
        """A data frame of the node's came in; its values, if it was any."""
        ids = self._ids
        if can_id == ids.tpdo:
            return self._on_values(now_s, data)
        if can_id == ids.sdo_answer:
            if self._machine.phase is not DrivePhase.ABSENT:
                self._machine.answered(now_s, None)
                self._sdo.on_answer(data)
                self._machine.surplus(now_s, self._sdo.surplus)
        elif can_id == ids.emcy:
            self._on_emergency(now_s, data)
        else:
            self._on_heartbeat(now_s, data)
        return []

    def _on_values(self, now_s: float, data: bytes) -> list[Sample | Event]:
        machine, said = self._machine, self._said
        try:
            word, position, torque = TPDO.unpack(data)
            referenced = self._boot.is_referenced
            if word != self.word or referenced is not said.referenced or said is NOTHING_SAID:
                power = decode_status_word(word)
                said = Said(power, bool(word & VOLTAGE_ENABLED), referenced)
        except ProtocolError as error:
            self._on_wrong_values(now_s, error)
            return []
        self._wrong = 0
        if machine.phase is DrivePhase.ABSENT or not self.is_mapped:
            return []  # of an earlier master's making: nobody knows what is mapped
        if self.pairs < self.slots:
            self.pairs += 1
        self.position, self.word, self._said = position, word, said
        machine.took_status(now_s, said)
        if not machine.started:
            return []  # its boot-up was heard: whether it makes force is all that counts
        machine.answered(now_s, "position")
        machine.answered(now_s, "force")
        at_s = self.syncs.answered(now_s)
        name, units = self._name, self._units
        return [
            Sample(name, "position", units.measured("position", position), at_s, now_s),
            Sample(name, "force", units.measured("force", torque), at_s, now_s),
        ]

    def _on_wrong_values(self, now_s: float, error: ProtocolError) -> None:
        self.garbage += 1
        self._wrong += 1
        if self._wrong >= self._profile.supervision.wrong_pdos and self._machine.started:
            self._machine.fault(now_s, "wrong_pdo", f"sends what is not mapped: {error}")

    def _on_emergency(self, now_s: float, data: bytes) -> None:
        """An emergency is one whatever its length: of all frames this one is never ignored."""
        machine = self._machine
        machine.heard_s = now_s
        if self.watch.is_storm(now_s):
            text = (
                f"{self._name} (node {self._node}) sends emergency messages in a storm: "
                "look at its display"
            )
            machine.events.append(Event(now_s, "warning", "emcy_storm", text))
        emergency = codec.decode_emcy(data)
        if emergency.code == 0:
            return
        name = "course_limitation" if emergency.code in COURSE_CODES else "drive_error"
        machine.fault(now_s, name, f"reports {self._profile.error_text(emergency.code)}")

    def _on_heartbeat(self, now_s: float, data: bytes) -> None:
        try:
            state = codec.decode_heartbeat(data)
        except ProtocolError:
            self.garbage += 1
            return
        machine = self._machine
        self.watch.heartbeat(now_s, state)
        if state is codec.NmtState.BOOT_UP and machine.phase is not DrivePhase.ABSENT:
            if machine.log_on(now_s):
                self._restarted()
        elif not machine.started:
            machine.heard_s = now_s
