"""CAN frames as values, and the 16-byte layout of Linux' `struct can_frame`."""

from __future__ import annotations

import struct
from typing import Final, NamedTuple

from hil.errors import ProtocolError

FRAME_BYTES: Final = 16
"""Size of `struct can_frame` (linux/can.h): id and flags, length, padding, eight data bytes."""

EFF_FLAG: Final = 0x8000_0000
RTR_FLAG: Final = 0x4000_0000
ERR_FLAG: Final = 0x2000_0000
SFF_MASK: Final = 0x7FF
EFF_MASK: Final = 0x1FFF_FFFF

BUS_SHIFT: Final = 29
"""Bits of the longest identifier."""

_LAYOUT: Final = struct.Struct("=IB3x8s")


class Frame(NamedTuple):
    """One classic CAN frame: 11-bit (or extended 29-bit) identifier and up to eight data bytes."""

    can_id: int
    data: bytes = b""
    is_extended: bool = False
    is_remote: bool = False
    is_error: bool = False
    bus: int = 0
    """Which of the rig's buses it travels on; a frame on the wire does not say."""

    @property
    def key(self) -> int:
        """Identifier and bus in one number: the identifier itself on a rig's first bus."""
        return self.bus << BUS_SHIFT | self.can_id

    def __str__(self) -> str:
        width = 8 if self.is_extended else 3
        body = "R" if self.is_remote else self.data.hex().upper()
        return f"{self.can_id:0{width}X}#{body}"


class StampedFrame(NamedTuple):
    """A frame and the instant at which it was received or sent, s on the caller's clock."""

    t_s: float
    frame: Frame


def pack(frame: Frame) -> bytes:
    """The 16 bytes of `struct can_frame` for `frame`; ProtocolError if it is no classic frame."""
    if len(frame.data) > 8:
        raise ProtocolError(
            f"frame {frame.can_id:#x} has {len(frame.data)} data bytes, at most 8 fit"
        )
    limit = EFF_MASK if frame.is_extended or frame.is_error else SFF_MASK
    if not 0 <= frame.can_id <= limit:
        raise ProtocolError(f"CAN identifier {frame.can_id:#x} is outside 0..{limit:#x}")
    word = (
        frame.can_id
        | (EFF_FLAG if frame.is_extended else 0)
        | (RTR_FLAG if frame.is_remote else 0)
        | (ERR_FLAG if frame.is_error else 0)
    )
    return _LAYOUT.pack(word, len(frame.data), frame.data)


def unpack(buffer: bytes) -> Frame:
    """The frame in the 16 bytes of `buffer`; ProtocolError if they are no classic frame."""
    if len(buffer) != FRAME_BYTES:
        raise ProtocolError(f"a CAN frame record has {FRAME_BYTES} bytes, got {len(buffer)}")
    word, length, data = _LAYOUT.unpack(buffer)
    if length > 8:
        raise ProtocolError(f"a classic CAN frame has at most 8 data bytes, got {length}")
    extended = bool(word & EFF_FLAG)
    error = bool(word & ERR_FLAG)
    mask = EFF_MASK if extended or error else SFF_MASK
    return Frame(word & mask, data[:length], extended, bool(word & RTR_FLAG), error)
