"""How late this PC wakes a loop like the daemon's, and how long a frame takes to a neighbour and back.

The loop is the control process's own kind: asyncio, woken by a timerfd, with the rights that it is given.
"""

from __future__ import annotations

import asyncio
import gc
import os
import select
import time
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hil.bus.port import BusPort, open_port
from hil.bus.timerfd import Timer
from hil.daemon.lock import RigLock
from hil.daemon.realtime import CalmGarbage, request_rights
from hil.errors import BusError
from hil.frames import Frame

PING_ID: Final = 0x7FE
PONG_ID: Final = 0x7FF
"""The lowest priorities there are: whoever else is on the bus goes first."""
PING_S: Final = 0.01
ANSWER_S: Final = 0.1

BANDS_US: Final = (20.0, 50.0, 500.0)
"""LinuxCNC's rule of thumb for a PC's worst lateness, µs [M]: up to 20 excellent, up to 50 good, up to
500 for loops closed elsewhere ("Latency Testing" in its documentation). hil's loops are: in the drives."""


@dataclass(frozen=True, slots=True)
class Latency:
    """One measurement."""

    cycle_s: float
    late_us: NDArray[np.float64]
    """Lateness of each wake, µs."""
    overruns: int
    """Cycles that were slept through."""
    rights: tuple[str, ...]
    """What the kernel granted, or not, as sentences."""
    load: float
    """Processes that wanted a processor, over the last minute, a processor."""
    round_trip_us: NDArray[np.float64]
    """A frame to another node of the bus and its answer, µs; empty where no bus was given."""

    def shares(self) -> tuple[float, ...]:
        """Shares of the wakes in each band, and in the rest."""
        edges = (-np.inf, *BANDS_US, np.inf)
        counts, _ = np.histogram(self.late_us, edges)
        return tuple((counts / self.late_us.size).tolist())


def measure_latency(cycle_s: float, seconds: float, bus: str | None, bitrate_bps: int) -> Latency:
    """Send frames to and fro on `bus` for `seconds`, then loop; this process gets real-time rights if it may.

    The bus first: one that cannot be used shall not cost what was measured before.

    BusError and RigInUse where the bus is not there, or a daemon is on it.
    """
    rights = tuple(right.text for right in request_rights())
    garbage = CalmGarbage()
    garbage.settle()
    garbage.arm()
    try:
        trips = np.empty(0)
        if bus is not None:
            with RigLock("latency", bus):
                trips = _round_trips(bus, bitrate_bps, seconds)
        late_us, overruns = asyncio.run(bare_loop(cycle_s, max(2, round(seconds / cycle_s))))
    finally:
        garbage.disarm()
        gc.unfreeze()
    load = os.getloadavg()[0] / (os.cpu_count() or 1)
    return Latency(cycle_s, late_us, overruns, rights, load, trips)


async def bare_loop(cycle_s: float, cycles: int) -> tuple[NDArray[np.float64], int]:
    """Wake every `cycle_s` without other work: lateness of the wakes, µs, and cycles slept through.

    Both together are `cycles`. Lateness is from the due instant to the callback; of cycles slept through,
    the first one tells how late the wake that ends them is.
    """
    loop = asyncio.get_running_loop()
    done: asyncio.Future[None] = loop.create_future()
    late_us = np.empty(cycles)
    woken = due = 0
    with Timer() as timer:
        first_s = time.monotonic() + 2.0 * cycle_s

        def expired() -> None:
            nonlocal woken, due
            now_s = time.monotonic()
            if due < cycles:
                late_us[woken] = (now_s - (first_s + due * cycle_s)) * 1e6
                woken += 1
            due += timer.expirations()
            if due >= cycles and not done.done():
                done.set_result(None)

        timer.arm_every(first_s, cycle_s)
        loop.add_reader(timer, expired)
        try:
            await done
        finally:
            loop.remove_reader(timer)
    return late_us[:woken], cycles - woken  # the last wake may be later than all that was asked for


def _round_trips(bus: str, bitrate_bps: int, seconds: float) -> NDArray[np.float64]:
    """Two nodes of this process: one asks, the other answers."""
    asking = open_port(bus, bitrate_bps=bitrate_bps)
    try:
        answering = open_port(bus, bitrate_bps=bitrate_bps)
        try:
            return _ping(asking, answering, seconds)
        finally:
            answering.close()
    finally:
        asking.close()


def _ping(asking: BusPort, answering: BusPort, seconds: float) -> NDArray[np.float64]:
    trips = []
    end_s = time.monotonic() + seconds
    number = 0
    while (begun_s := time.monotonic()) < end_s:
        number += 1
        data = number.to_bytes(8, "little")
        asking.send(Frame(PING_ID, data))
        _await(answering, Frame(PING_ID, data))
        answering.send(Frame(PONG_ID, data))
        _await(asking, Frame(PONG_ID, data))
        now_s = time.monotonic()
        trips.append((now_s - begun_s) * 1e6)
        time.sleep(max(0.0, begun_s + PING_S - now_s))
    return np.array(trips)


def _await(port: BusPort, wanted: Frame) -> None:
    end_s = time.monotonic() + ANSWER_S
    while (left_s := end_s - time.monotonic()) > 0.0:
        select.select([port], [], [], left_s)
        if any(frame == wanted for _, frame in port.receive()):
            return
    raise BusError(
        f"{port.name}: a frame did not arrive within {ANSWER_S:g} s; a real bus carries none unless another "
        "node is there to acknowledge it"
    )
