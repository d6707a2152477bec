"""A timer that is a file descriptor: absolute, on CLOCK_MONOTONIC, counting what was missed.

asyncio rounds its own timers up to a whole millisecond (the resolution of epoll); a timerfd in
`add_reader` wakes the loop within some tens of microseconds. Python has `os.timerfd_create` from
3.13; until then the two calls are made through ctypes (timerfd_create(2)) [M].
"""

from __future__ import annotations

import ctypes
import os
import struct
import time
from types import TracebackType
from typing import Final, Self

from hil.errors import BusError

_TFD_NONBLOCK: Final = os.O_NONBLOCK
_TFD_CLOEXEC: Final = os.O_CLOEXEC
_TFD_TIMER_ABSTIME: Final = 1
_COUNT: Final = struct.Struct("=Q")


class _Timespec(ctypes.Structure):
    _fields_ = (("seconds", ctypes.c_long), ("nanoseconds", ctypes.c_long))


class _Itimerspec(ctypes.Structure):
    _fields_ = (("interval", _Timespec), ("value", _Timespec))


_libc = ctypes.CDLL(None, use_errno=True)
_libc.timerfd_create.argtypes = (ctypes.c_int, ctypes.c_int)
_libc.timerfd_settime.argtypes = (
    ctypes.c_int,
    ctypes.c_int,
    ctypes.POINTER(_Itimerspec),
    ctypes.POINTER(_Itimerspec),
)


def _checked(result: int, call: str) -> int:
    if result < 0:
        raise BusError(f"{call} failed: {os.strerror(ctypes.get_errno())}")
    return result


class Timer:
    """A timerfd on CLOCK_MONOTONIC, disarmed until told otherwise; BusError if none can be had."""

    def __init__(self) -> None:
        self._fd = _checked(
            _libc.timerfd_create(time.CLOCK_MONOTONIC, _TFD_NONBLOCK | _TFD_CLOEXEC),
            "timerfd_create",
        )

    def fileno(self) -> int:
        """The descriptor, readable when the timer has expired; -1 once closed."""
        return self._fd

    def arm_at(self, t_s: float) -> None:
        """Expire once at `t_s` (CLOCK_MONOTONIC, s), at once if that is past."""
        self._arm(t_s, 0.0)

    def arm_every(self, first_s: float, period_s: float) -> None:
        """Expire at `first_s` (CLOCK_MONOTONIC, s) and then every `period_s`, without drift."""
        if period_s <= 0.0:
            raise ValueError(f"the period of a timer must be positive, got {period_s} s")
        self._arm(first_s, period_s)

    def disarm(self) -> None:
        """Expire no more."""
        self._set(0, 0)

    def expirations(self) -> int:
        """Expirations since the last call: 0 none, 1 in time, more = periods overrun."""
        try:
            return int(_COUNT.unpack(os.read(self._fd, _COUNT.size))[0])
        except BlockingIOError:
            return 0

    def close(self) -> None:
        """Give the descriptor back; closing twice is no error."""
        if self._fd >= 0:
            os.close(self._fd)
            self._fd = -1

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def _arm(self, first_s: float, period_s: float) -> None:
        # A value of zero would disarm: the past is asked for as the first nanosecond of the clock.
        self._set(max(1, round(first_s * 1e9)), round(period_s * 1e9))

    def _set(self, first_ns: int, period_ns: int) -> None:
        setting = _Itimerspec(
            _Timespec(*divmod(period_ns, 1_000_000_000)),
            _Timespec(*divmod(first_ns, 1_000_000_000)),
        )
        _checked(
            _libc.timerfd_settime(self._fd, _TFD_TIMER_ABSTIME, ctypes.byref(setting), None),
            "timerfd_settime",
        )
