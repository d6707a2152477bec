"""Asks the kernel for real-time rights and says in a sentence what was got, or why not.

Nothing here is needed to run; each right makes the loop's lateness smaller and rarer.
"""

from __future__ import annotations

import ctypes
import gc
import os
from contextlib import suppress
from dataclasses import dataclass
from typing import Final

PRIORITY: Final = 50
"""SCHED_FIFO priority: above user threads, level with the kernel's threaded interrupt handlers."""

GATEWAY_NICE: Final = -10
"""Of the gateway: not real-time, but a rig whose gateway is starved takes it for gone, and parks."""

_MCL_CURRENT_AND_FUTURE: Final = 1 | 2
"""MCL_CURRENT | MCL_FUTURE of <sys/mman.h>, Linux on x86 and ARM."""


@dataclass(frozen=True, slots=True)
class Right:
    """The outcome of asking for one right; `text` is a sentence for the log and `hil` reports."""

    name: str
    is_granted: bool
    text: str


def request_rights(priority: int = PRIORITY) -> list[Right]:
    """Ask for everything that the control loop wants: real-time scheduling and locked memory."""
    return [request_fifo(priority), lock_memory()]


def request_fifo(priority: int = PRIORITY) -> Right:
    """Run this process under SCHED_FIFO; children start with ordinary scheduling again."""
    policy = os.SCHED_FIFO | os.SCHED_RESET_ON_FORK
    try:
        os.sched_setscheduler(0, policy, os.sched_param(priority))
    except PermissionError:
        return Right(
            "fifo",
            False,
            f"no real-time scheduling: SCHED_FIFO {priority} is not permitted; allow it with "
            f"LimitRTPRIO={priority} in the unit, or `rtprio` in /etc/security/limits.conf",
        )
    except OSError as error:
        return Right("fifo", False, f"no real-time scheduling: {error.strerror}")
    return Right("fifo", True, f"real-time scheduling: SCHED_FIFO, priority {priority}")


def request_precedence(nice: int = GATEWAY_NICE) -> None:
    """Go before what else runs on this computer, where that is allowed; threads made later inherit it."""
    with suppress(OSError):
        os.setpriority(os.PRIO_PROCESS, 0, min(nice, os.getpriority(os.PRIO_PROCESS, 0)))


def lock_memory() -> Right:
    """Keep all present and future memory of this process in RAM: page faults cost milliseconds."""
    libc = ctypes.CDLL(None, use_errno=True)
    if libc.mlockall(_MCL_CURRENT_AND_FUTURE) == 0:
        return Right("memory", True, "memory is locked in RAM")
    error = ctypes.get_errno()
    return Right(
        "memory",
        False,
        f"memory is not locked: {os.strerror(error)}; allow it with LimitMEMLOCK=infinity "
        "in the unit, or `memlock` in /etc/security/limits.conf",
    )


class CalmGarbage:
    """Keeps Python's garbage collector out of the loop while the rig is armed.

    A whole collection takes a tenth of a second: longer than a drive's watchdog waits. So it is done once,
    before the loop begins; what lives then is frozen, and collections while disarmed stay short. While
    armed there are none: reference counting frees everything without cycles, and the loop makes none.
    """

    def __init__(self) -> None:
        self.is_calm = False

    def settle(self) -> None:
        """Collect once and freeze what is left. Call before the loop begins."""
        gc.collect()
        gc.freeze()

    def arm(self) -> None:
        """No collection from now on."""
        if not self.is_calm:
            gc.disable()
            self.is_calm = True

    def disarm(self) -> None:
        """Back to ordinary collection."""
        if self.is_calm:
            gc.enable()
            self.is_calm = False
