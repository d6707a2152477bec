"""What the master's CANopen frames ask, read back from their bytes for the gate.

Whatever moves a drive goes by process data: the objects that do the same by SDO are never written.
"""

from __future__ import annotations

from typing import Final

from hil.config import RigFile
from hil.drives.cia402 import codec
from hil.drives.cia402.mapping import KIND_OF, Units, candidates, rpdo
from hil.drives.cia402.profile import Cia402Profile
from hil.drives.meaning import Ask, Meaning
from hil.drives.power import PowerCommand, decode_control_word
from hil.drives.profiles import Profiles
from hil.errors import ProtocolError

MOVING: Final = frozenset({0x6040, 0x6071, 0x607A, 0x60B0, 0x60B1, 0x60B2, 0x60C1, 0x60FF})
"""Control word, targets and offsets."""
INTERPOLATE: Final = 0x0010
"""Bit 4 of the control word in mode ip: follow the set-points; in homing: begin."""
_WITHOUT_FORCE: Final = (PowerCommand.DISABLE, PowerCommand.QUICK_STOP, PowerCommand.PREPARE)


def _asked(word: int) -> Ask:
    command = decode_control_word(word)
    if command in _WITHOUT_FORCE:
        return Ask.POWER_OFF
    return Ask.FAULT_RESET if command is PowerCommand.RESET else Ask.POWER_ON


_ASKS: Final = {
    word: _asked(word)
    for word in (*(c.value for c in PowerCommand), PowerCommand.ENABLE.value | INTERPOLATE)
}
"""What each control word that hil sends asks; others are none of ours."""
_SEGMENT_OR_ABORT: Final = (0x00, 0x60, 0x80)


NUMBERS: Final = range(1 << 24)
"""That an object may have."""


def number_of(index: int, sub: int) -> int:
    """One number for an object, as `Meaning.parameter` has it."""
    return index << 8 | sub


class Cia402Meaning:
    """Reads NMT, SYNC, our heartbeat, SDO requests and process data to the drives of one bus."""

    def __init__(self, rig: RigFile, profiles: Profiles, master_nodes: frozenset[int]) -> None:
        self.lengths: dict[int, int] = {codec.NMT_ID: codec.NMT_LENGTH, codec.SYNC_ID: 0}
        self._alive = frozenset(codec.HEARTBEAT_BASE + node for node in master_nodes)
        self.lengths |= dict.fromkeys(self._alive, codec.HEARTBEAT_LENGTH)
        self._targets: dict[int, int] = {}
        self._requests: dict[int, int] = {}
        self._layouts = []
        self._kinds = []
        self._units = []
        self._writable: list[frozenset[int]] = []
        for i, actuator in enumerate(rig.actuators):
            ids, mode = codec.node_ids(rig.address(i)), candidates(rig, actuator)[0]
            layout = rpdo(mode)
            self._layouts.append(layout)
            self._kinds.append(KIND_OF[mode])
            self._units.append(Units(actuator))
            self._targets[ids.rpdo], self._requests[ids.sdo_request] = i, i
            self.lengths |= {ids.rpdo: layout.length, ids.sdo_request: codec.SDO_LENGTH}
            profile = profiles[actuator.drive.profile]
            assert isinstance(profile, Cia402Profile)
            self._writable.append(writable_objects(profile))
        self._nodes = {rig.address(i): i for i in range(len(rig.actuators))}

    def writable(self, i: int) -> frozenset[int]:
        """Numbers of the objects that the EDS of drive i lets be written."""
        return self._writable[i]

    def meaning(self, can_id: int, data: bytes) -> Meaning:
        """What a frame asks; its identifier and length are those of `lengths`."""
        i = self._targets.get(can_id)
        if i is not None:
            return self._of_target(i, data)
        if can_id == codec.SYNC_ID:
            return Meaning(Ask.SYNC)
        if can_id in self._requests:
            return self._of_request(self._requests[can_id], data)
        if can_id in self._alive:
            return Meaning(Ask.ALIVE)
        return self._of_nmt(data)

    def _of_nmt(self, data: bytes) -> Meaning:
        try:
            command, node = codec.decode_nmt(data)
        except ProtocolError as error:
            return Meaning(Ask.UNKNOWN, text=str(error))
        if node and node not in self._nodes:
            return Meaning(Ask.UNKNOWN, text=f"node {node} is no drive of this rig")
        text = command.name.lower().replace("_", " ")
        return Meaning(Ask.NETWORK, self._nodes.get(node), text=text)

    def _of_target(self, i: int, data: bytes) -> Meaning:
        word, target = self._layouts[i].unpack(data)
        ask = _ASKS.get(word)
        if ask is None:
            return Meaning(Ask.UNKNOWN, i, text=f"control word {word:#06x} is no command")
        if ask is not Ask.POWER_ON:
            return Meaning(ask, i)
        kind = self._kinds[i]
        return Meaning(ask, i, kind, self._units[i].si(kind, target))

    def _of_request(self, i: int, data: bytes) -> Meaning:
        command, number = data[0] & 0xE0, number_of(data[1] | data[2] << 8, data[3])
        if command == 0x20:
            value = int.from_bytes(data[4:], "little")
            return Meaning(Ask.WRITE, i, parameter=number, value=value)
        if command == 0x40:
            return Meaning(Ask.READ, i, parameter=number)
        if command in _SEGMENT_OR_ABORT:  # goes on with, or ends, what its first frame was let do
            return Meaning(Ask.READ, i)
        return Meaning(Ask.UNKNOWN, i, text=f"SDO command {data[0]:#04x} is never sent")


def writable_objects(profile: Cia402Profile) -> frozenset[int]:
    """Numbers of the objects that the EDS lets be written, less those that move the drive."""
    return frozenset(
        number_of(e.index, e.sub) for e in profile.objects if e.writable and e.index not in MOVING
    )
