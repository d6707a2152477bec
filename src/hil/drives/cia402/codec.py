"""CANopen frames of a master and its CiA 402 drives: identifiers, NMT, heartbeat, EMCY, process data.

CiA 301 (EN 50325-4), pre-defined connection set: an identifier is a function code and the node's number,
1 to 127 [M]. All numbers are little endian. Pure; decoding raises ProtocolError on what cannot be.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from enum import IntEnum
from typing import Final

from hil.errors import ProtocolError

NMT_ID: Final = 0x000
SYNC_ID: Final = 0x080
EMCY_BASE: Final = 0x080
TPDO_BASES: Final = (0x180, 0x280, 0x380, 0x480)
RPDO_BASES: Final = (0x200, 0x300, 0x400, 0x500)
SDO_ANSWER_BASE: Final = 0x580
SDO_REQUEST_BASE: Final = 0x600
HEARTBEAT_BASE: Final = 0x700
LARGEST_NODE: Final = 127

NMT_LENGTH: Final = 2
SDO_LENGTH: Final = 8
HEARTBEAT_LENGTH: Final = 1
EMCY_LENGTH: Final = 8


class NmtCommand(IntEnum):
    """What an NMT master asks of a node."""

    START = 0x01
    STOP = 0x02
    PRE_OPERATIONAL = 0x80
    RESET_NODE = 0x81
    RESET_COMMUNICATION = 0x82


class NmtState(IntEnum):
    """What a heartbeat says."""

    BOOT_UP = 0x00
    STOPPED = 0x04
    OPERATIONAL = 0x05
    PRE_OPERATIONAL = 0x7F

    def __str__(self) -> str:
        return self.name.lower().replace("_", "-")


@dataclass(frozen=True, slots=True)
class NodeIds:
    """Identifiers of one node's frames."""

    emcy: int
    tpdo: int
    rpdo: int
    sdo_answer: int
    sdo_request: int
    heartbeat: int


def node_ids(node: int) -> NodeIds:
    """Identifiers of node 1..127; ProtocolError outside."""
    if not 1 <= node <= LARGEST_NODE:
        raise ProtocolError(f"a CANopen node has a number from 1 to {LARGEST_NODE}, not {node}")
    return NodeIds(
        EMCY_BASE + node,
        TPDO_BASES[0] + node,
        RPDO_BASES[0] + node,
        SDO_ANSWER_BASE + node,
        SDO_REQUEST_BASE + node,
        HEARTBEAT_BASE + node,
    )


def encode_nmt(command: NmtCommand, node: int) -> bytes:
    """Data of an NMT frame to `node`; 0 means all."""
    return bytes((command, node))


def decode_nmt(data: bytes) -> tuple[NmtCommand, int]:
    """Command and node of an NMT frame."""
    if len(data) != NMT_LENGTH:
        raise ProtocolError(f"an NMT frame has {NMT_LENGTH} bytes, not {len(data)}")
    try:
        return NmtCommand(data[0]), data[1]
    except ValueError:
        raise ProtocolError(f"NMT command {data[0]:#04x} does not exist") from None


def encode_heartbeat(state: NmtState) -> bytes:
    """Data of a heartbeat."""
    return bytes((state,))


def decode_heartbeat(data: bytes) -> NmtState:
    """State in a heartbeat; bit 7 toggles with node guarding and means nothing here."""
    if len(data) != HEARTBEAT_LENGTH:
        raise ProtocolError(f"a heartbeat has {HEARTBEAT_LENGTH} byte, not {len(data)}")
    try:
        return NmtState(data[0] & 0x7F)
    except ValueError:
        raise ProtocolError(f"NMT state {data[0]:#04x} does not exist") from None


_EMCY: Final = struct.Struct("<HB5s")


@dataclass(frozen=True, slots=True)
class Emergency:
    """An emergency: error code (0: no error any more), error register 0x1001, manufacturer's five bytes."""

    code: int
    register: int
    more: bytes = bytes(5)


def encode_emcy(emergency: Emergency) -> bytes:
    """Data of an EMCY frame."""
    return _EMCY.pack(emergency.code, emergency.register, emergency.more)


def decode_emcy(data: bytes) -> Emergency:
    """What an EMCY frame says; one of a wrong length tells its code where it has two bytes, else 0x1000."""
    if len(data) == EMCY_LENGTH:
        return Emergency(*_EMCY.unpack(data))
    code = int.from_bytes(data[:2], "little") if len(data) >= 2 else GENERIC_ERROR
    return Emergency(code, 0)


GENERIC_ERROR: Final = 0x1000
"""CiA 301's error code for an error that is not specified further."""


@dataclass(frozen=True, slots=True)
class Field:
    """One object in a PDO: name of its meaning, index, subindex, bytes, signed or not."""

    name: str
    index: int
    sub: int
    size: int
    signed: bool

    @property
    def entry(self) -> int:
        """The mapping entry: index, subindex, length in bits."""
        return self.index << 16 | self.sub << 8 | 8 * self.size


class PdoLayout:
    """The fields of one PDO, packed without gaps."""

    def __init__(self, fields: tuple[Field, ...]) -> None:
        self.fields = fields
        codes = {1: "b", 2: "h", 4: "i"}
        letters = (codes[f.size] if f.signed else codes[f.size].upper() for f in fields)
        self._struct = struct.Struct("<" + "".join(letters))
        self.length = self._struct.size
        if self.length > 8:
            raise ProtocolError(f"a PDO carries 8 bytes, these fields need {self.length}")

    def pack(self, *values: int) -> bytes:
        """Data of the PDO; values outside their field saturate."""
        try:
            return self._struct.pack(*values)
        except struct.error:
            whole = zip(values, self.fields, strict=True)
            return self._struct.pack(*(clamp(v, f.size, signed=f.signed) for v, f in whole))

    def unpack(self, data: bytes) -> tuple[int, ...]:
        """Values of the fields; ProtocolError where the length is another."""
        if len(data) != self.length:
            raise ProtocolError(f"its PDO has {len(data)} bytes, {self.length} are mapped")
        return self._struct.unpack(data)


def clamp(value: float, size: int, *, signed: bool) -> int:
    """`value` rounded to an integer of `size` bytes, at the nearest end where it does not fit."""
    low, high = (
        (-(1 << 8 * size - 1), (1 << 8 * size - 1) - 1) if signed else (0, (1 << 8 * size) - 1)
    )
    return int(min(max(round(value), low), high))
