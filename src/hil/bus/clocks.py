"""The clock of the loop, CLOCK_MONOTONIC, and the kernel's receive stamps brought onto it."""

from __future__ import annotations

import socket
import struct
import time
from collections.abc import Sequence
from typing import Final

SO_TIMESTAMPNS: Final = 35
"""Socket option and ancillary type, asm-generic/socket.h; Python's socket module has no name."""

STAMP_ROOM: Final = socket.CMSG_SPACE(16)
"""Bytes of ancillary data that a receive call must offer for one stamp."""

_TIMESPEC: Final = struct.Struct("@ll")
_OLDEST_S: Final = 5.0
"""A stamp further back than this is taken for a step of the wall clock, not for a wait."""


def request_stamps(sock: socket.socket) -> None:
    """Ask the kernel to stamp what `sock` receives. CAN and Unix sockets know this."""
    sock.setsockopt(socket.SOL_SOCKET, SO_TIMESTAMPNS, 1)


def monotonic_minus_realtime_s() -> float:
    """Offset from the wall clock, in which the kernel stamps, to CLOCK_MONOTONIC, s."""
    return (time.monotonic_ns() - time.clock_gettime_ns(time.CLOCK_REALTIME)) * 1e-9


def received_s(ancillary: Sequence[tuple[int, int, bytes]], offset_s: float, now_s: float) -> float:
    """Instant of reception on CLOCK_MONOTONIC, s.

    `offset_s` is `monotonic_minus_realtime_s()` taken beside `now_s`. Without a stamp, or with
    one that a step of the wall clock has spoilt, it is `now_s`.
    """
    for level, kind, data in ancillary:
        if level == socket.SOL_SOCKET and kind == SO_TIMESTAMPNS and len(data) == _TIMESPEC.size:
            seconds, nanoseconds = _TIMESPEC.unpack(data)
            stamp_s = seconds + offset_s + nanoseconds * 1e-9
            return stamp_s if now_s - _OLDEST_S < stamp_s <= now_s else now_s
    return now_s
