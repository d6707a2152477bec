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
_QUICK_NS: Final = 50_000
_TRIES: Final = 5
_MOST_NS: Final = 1 << 62
_OLDEST_S: Final = 5.0
"""A stamp further back than this is taken for a step of the wall clock, not for a wait."""


def request_stamps(sock: socket.socket) -> None:
    """Ask the kernel to stamp what `sock` receives. CAN and Unix sockets know this."""
    sock.setsockopt(socket.SOL_SOCKET, SO_TIMESTAMPNS, 1)


def monotonic_minus_realtime_s() -> float:
    """Offset from the wall clock, in which the kernel stamps, to CLOCK_MONOTONIC, s.

    A process that is made to wait between reading one clock and the other would be wrong by that wait, so
    it looks again until it was quick, or takes the quickest of some tries.
    """
    width_ns, offset_ns = _MOST_NS, 0
    for _ in range(_TRIES):
        before_ns = time.monotonic_ns()
        wall_ns = time.clock_gettime_ns(time.CLOCK_REALTIME)
        after_ns = time.monotonic_ns()
        if after_ns - before_ns < width_ns:
            width_ns, offset_ns = after_ns - before_ns, (before_ns + after_ns) // 2 - wall_ns
        if width_ns < _QUICK_NS:
            break
    return offset_ns * 1e-9


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
