"""Runs a simulated rig against the clock on a real bus port: the process behind `hil simulate`."""

from __future__ import annotations

import asyncio
import math
import signal
import time
from collections.abc import Callable
from contextlib import suppress
from functools import partial

from hil.bus.port import BusPort
from hil.bus.timerfd import Timer
from hil.errors import BusBusy, BusOff
from hil.sim.rig import SimulatedRig


class SimulatedRigServer:
    """Feeds frames and time to a simulated rig, a port for each of its buses.

    The plant's clock starts with `run`.
    """

    def __init__(self, simulated: SimulatedRig, *ports: BusPort) -> None:
        self._simulated = simulated
        self._ports = ports
        self._start_s = 0.0
        self._failed: asyncio.Future[None]
        self._timer = Timer()
        self.unsent = 0
        """Frames that the bus did not take."""

    async def run(self) -> None:
        """Serve until cancelled; BusError if the bus is lost."""
        loop = asyncio.get_running_loop()
        self._failed = loop.create_future()
        self._start_s = time.monotonic() - self._simulated.plant.now_s
        for bus, port in enumerate(self._ports):
            loop.add_reader(port.fileno(), self._guarded, partial(self._on_frames, port, bus))
        loop.add_reader(self._timer.fileno(), self._guarded, self._on_timer)
        self._guarded(self._on_timer)
        try:
            await self._failed
        finally:
            for port in self._ports:
                loop.remove_reader(port.fileno())
            loop.remove_reader(self._timer.fileno())
            self._timer.close()

    def _guarded(self, action: Callable[[], None]) -> None:
        try:
            action()
            due_s = self._simulated.next_due_s
            if due_s < math.inf:  # a rig without IMU whose drives wait for frames has nothing due
                self._timer.arm_at(due_s + self._start_s)
        except Exception as error:  # noqa: BLE001 - handed to whoever awaits run()
            if not self._failed.done():
                self._failed.set_exception(error)

    def _on_frames(self, port: BusPort, bus: int) -> None:
        for t_s, frame in port.receive():
            marked = frame._replace(bus=bus) if bus else frame
            self._simulated.on_frame(t_s - self._start_s, marked)

    def _on_timer(self) -> None:
        self._timer.expirations()
        for frame in self._simulated.on_time(time.monotonic() - self._start_s):
            try:
                self._ports[frame.bus].send(frame)
            except (BusBusy, BusOff):  # a drive's power outlasts its bus
                self.unsent += 1


async def serve_until_signalled(simulated: SimulatedRig, *ports: BusPort) -> None:
    """Serve until SIGINT or SIGTERM."""
    loop = asyncio.get_running_loop()
    task = asyncio.ensure_future(SimulatedRigServer(simulated, *ports).run())
    for signum in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(signum, task.cancel)
    with suppress(asyncio.CancelledError):
        await task
