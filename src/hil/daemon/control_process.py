"""The control process: one asyncio loop around the pure core, woken by a timerfd and by the bus.

It opens no file and no Zenoh session: everything it has to tell goes to the gateway as records, in sends that
never block. Only once the gateway is gone do its events go to the log.
"""

from __future__ import annotations

import asyncio
import signal
import socket
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Final

from hil.bus.load import frame_bits
from hil.bus.port import BusPort
from hil.bus.timerfd import Timer
from hil.config import RigFile
from hil.daemon.core import RigCore
from hil.daemon.cue_parts import CueJoiner
from hil.daemon.ipc import Channel
from hil.daemon.late_commands import too_late
from hil.daemon.log import Log
from hil.daemon.realtime import CalmGarbage, request_rights
from hil.daemon.records import (
    CommandRecord,
    CueRecord,
    EventRecord,
    GatewayAlive,
    Record,
)
from hil.daemon.sdnotify import Notifier
from hil.drives.driver import DriveBus
from hil.errors import BusError
from hil.frames import Frame
from hil.signals import Severity

STATUS_S: Final = 1.0
"""Between two status lines for systemd."""
LOAD_S: Final = 0.5
"""Over which the bus load is averaged."""
TELL_S: Final = 0.004
"""Least time between two datagrams to the gateway: a wake of it for each cycle of 1 ms would cost it dear."""
GATEWAY_START_S: Final = 15.0
"""The gateway gets so long to come up, and then GATEWAY_HUNG_S more: nothing is recorded before it is there,
and the rig is disarmed."""
GATEWAY_HUNG_S: Final = 5.0
"""A gateway that lives and says nothing for so long will not come back: the rig has parked by then, and
whoever started the daemon had better start it anew."""


@dataclass(slots=True)
class BusLoad:
    """Share of the bus's bit time in use, from the frames seen, over LOAD_S."""

    bitrate_bps: int
    since_s: float
    bits: int = 0
    load: float = float("nan")

    def add(self, frame: Frame) -> None:
        """Count a frame sent or received."""
        self.bits += frame_bits(frame)

    def at(self, now_s: float) -> float:
        """The load of the last full stretch."""
        if now_s - self.since_s >= LOAD_S:
            self.load = self.bits / self.bitrate_bps / (now_s - self.since_s)
            self.since_s, self.bits = now_s, 0
        return self.load


class ControlProcess:
    """Runs one rig until told to end; then parks, switches the drives off and leaves.

    `ports`: one for each of its buses.
    """

    def __init__(
        self,
        rig: RigFile,
        drives: DriveBus,
        ports: Sequence[BusPort],
        gateway: socket.socket,
        notifier: Notifier,
        log: Log,
    ) -> None:
        now_s = time.monotonic()
        self._rig = rig
        self._ports = tuple(ports)
        self._where = ", ".join(port.name for port in ports)
        read_only = any(port.read_only for port in ports)
        self._core = RigCore(rig, drives, now_s + rig.bus.cycle, read_only=read_only)
        self._channel = Channel(gateway)
        # All answers belong to the SYNC before, and the kernel stamps them: a wake for each is not needed.
        self._reads_at_sync = drives.is_synchronous and rig.bus.schedule == "fast"
        self._joiner = CueJoiner()
        self._notifier = notifier
        self._log = log
        self._timer = Timer()
        self._garbage = CalmGarbage()
        self._loads = tuple(BusLoad(bitrate, now_s) for bitrate in rig.can.bitrates)
        self._status_s = now_s
        self._tell_s = now_s
        self._alive_s = now_s
        self._gateway_s = now_s
        self._said_s = now_s
        """When the gateway sent the heartbeat that was read last."""
        self._has_gateway = False
        self.gateway_died = False
        """The gateway process ended before this one, or hangs."""
        self._done: asyncio.Future[None]
        self._gateway_here: asyncio.Future[None]

    @property
    def power_was_cut(self) -> bool:
        """The rig did not park: an emergency cut its power on the way to the end."""
        return self._core.is_cut

    async def run(self) -> None:
        """Serve until the end; BusError if the bus is lost for good."""
        loop = asyncio.get_running_loop()
        self._done, self._gateway_here = loop.create_future(), loop.create_future()
        for right in request_rights():
            now_s, name = time.monotonic(), f"right_{right.name}"
            severity: Severity = "info" if right.is_granted else "warning"
            self._channel.send(EventRecord(now_s, severity, name, right.text))
        for signum in (signal.SIGINT, signal.SIGTERM):
            loop.add_signal_handler(signum, self.end)
        loop.add_reader(self._channel.fileno(), self._guarded, self._on_gateway)
        # Whoever is told that we are ready may give commands, and the recording shall hold all of the run.
        await asyncio.wait(
            (self._gateway_here, self._done),
            timeout=GATEWAY_START_S,
            return_when=asyncio.FIRST_COMPLETED,
        )
        readers: list[tuple[int, Callable[[], None]]] = [(self._timer.fileno(), self._on_timer)]
        if not self._reads_at_sync:
            readers += [
                (p.fileno(), partial(self._on_frames, k)) for k, p in enumerate(self._ports)
            ]
        for fd, action in readers:
            loop.add_reader(fd, self._guarded, action)
        self._garbage.settle()
        for port in self._ports:
            while port.receive():
                pass  # what the bus said while we were getting ready is old news
        self._gateway_s = time.monotonic()
        self._core.start_at(self._gateway_s + self._rig.bus.cycle)
        self._timer.arm_at(self._core.next_due_s)
        self._notifier.ready(f"{self._rig.name} on {self._where}: {self._core.state}")
        try:
            await self._done
        finally:
            self._notifier.stopping("the control process ends")
            for fd in (*(fd for fd, _ in readers), self._channel.fileno()):
                loop.remove_reader(fd)
            self._tell(*self._core.take_records())
            self._channel.close()
            self._timer.close()

    def end(self) -> None:
        """Park if the rig is up, switch the drives off, then leave. Told again, it parks on all the same."""
        if self._core.is_ending:
            return
        self._stop_waiting()
        self._core.end()
        self._notifier.stopping("parking")

    def _stop_waiting(self) -> None:
        """The gateway is there, or it is no use to wait for it."""
        if not self._gateway_here.done():
            self._gateway_here.set_result(None)

    def _guarded(self, action: Callable[[], None]) -> None:
        try:
            action()
        except Exception as error:  # noqa: BLE001 - whoever awaits run() gets it
            if not self._done.done():
                self._done.set_exception(error)

    def _on_frames(self, bus: int) -> None:
        for t_s, frame in self._ports[bus].receive():
            self._loads[bus].add(frame)
            self._core.on_frame(t_s, frame._replace(bus=bus) if bus else frame)

    def _on_timer(self) -> None:
        self._timer.expirations()
        now_s = time.monotonic()
        self._core.bus_load = max(load.at(now_s) for load in self._loads)
        self._send(now_s, self._core.on_due(now_s))
        if self._core.next_due_s <= now_s:  # SYNC went out alone: now what belongs to this cycle
            if self._reads_at_sync:
                for k in range(len(self._ports)):
                    self._on_frames(k)
            now_s = time.monotonic()
            self._send(now_s, self._core.on_due(now_s))
        self._timer.arm_at(self._core.next_due_s)
        if now_s >= self._tell_s:
            self._tell_s = now_s + TELL_S
            self._tell(*self._core.take_records())
        self._calm()
        self._notify(now_s)
        self._watch_gateway(now_s)
        if self._core.has_ended and not self._done.done():
            self._done.set_result(None)

    def _on_gateway(self) -> None:
        now_s = time.monotonic()
        for record in self._channel.receive():
            if isinstance(record, CueRecord):
                cue = self._joiner.add(record)
                if cue is not None:
                    self._core.cue(now_s, cue)
            elif isinstance(record, CommandRecord):
                told = too_late(record, now_s, self._said_s)
                if told:
                    self._tell(*told)
                else:
                    self._core.command(now_s, record)
            elif isinstance(record, GatewayAlive):
                self._core.gateway_alive(now_s)
                self._gateway_s, self._said_s = now_s, record.t_s
                self._has_gateway = True
                self._stop_waiting()
        if not self._channel.is_open:
            asyncio.get_running_loop().remove_reader(self._channel.fileno())
            self._lose_gateway(now_s, "gateway_gone", "the gateway process has ended")

    def _send(self, now_s: float, frames: Sequence[Frame]) -> None:
        for frame in frames:
            try:
                self._ports[frame.bus].send(frame)
                self._loads[frame.bus].add(frame)
            except BusError as error:
                self._core.on_refused(now_s, frame, error)

    def _calm(self) -> None:
        if self._core.armed:
            self._garbage.arm()
        else:
            self._garbage.disarm()

    def _notify(self, now_s: float) -> None:
        watchdog_s = self._notifier.watchdog_s
        if watchdog_s is not None and now_s - self._alive_s >= watchdog_s:
            self._alive_s = now_s
            self._notifier.alive()
        if now_s - self._status_s >= STATUS_S:
            self._status_s = now_s
            self._notifier.status(f"{self._rig.name} on {self._where}: {self._core.state}")

    def _watch_gateway(self, now_s: float) -> None:
        if not self._core.is_ending and now_s - self._gateway_s > GATEWAY_HUNG_S:
            text = f"the gateway process says nothing for {GATEWAY_HUNG_S:g} s"
            if not self._has_gateway:
                text = (
                    f"the gateway process has not come up in {GATEWAY_START_S + GATEWAY_HUNG_S:g} s"
                )
            self._lose_gateway(now_s, "gateway_hung", text)

    def _lose_gateway(self, now_s: float, name: str, text: str) -> None:
        """Nobody records or publishes any more: park, and let whoever started us start anew."""
        self.gateway_died = True
        if not self._core.is_ending:
            text = f"{text}: the rig parks and the daemon ends"
            self._tell(EventRecord(now_s, "fault", name, text))
            self.end()

    def _tell(self, *records: Record) -> None:
        self._channel.send(*records)
        if self.gateway_died:
            for record in records:
                if isinstance(record, EventRecord):
                    self._log.event(record.severity, record.name, record.text)
