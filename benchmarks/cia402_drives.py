"""Six CiA 402 drives that cost nearly nothing, behind sockets that look like hubs, and a stopwatch at them.

What is asked over SDO and NMT the simulated drives answer; targets and SYNC, a thousand times a second, are
answered here, by drives that are where they were told to be, if they can. The kernel stamps every frame:
lateness and missed setpoints are measured where they matter, at the drives, and alike for every master.
"""

from __future__ import annotations

import select
import socket
import struct
import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hil.bus.socketport import SocketPort
from hil.config import RigFile
from hil.daemon.realtime import PRIORITY, request_fifo
from hil.drives.cia402 import codec
from hil.drives.power import PowerState
from hil.drives.profiles import Profiles
from hil.errors import BusBusy, BusError
from hil.frames import Frame
from hil.sim.cia402.drive import SimulatedCia402
from hil.sim.rig import SimulatedRig

TARGET = struct.Struct("<Hi")
ANSWER = struct.Struct("<Hih")
TIDY_S = 0.01
"""How often the drives look after heartbeats and watchdogs."""
MOST = 2_000_000
"""SYNCs that are remembered."""
Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Seen:
    """What the drives saw: instants of SYNC (k,), of the last target after each (k,), s on CLOCK_MONOTONIC,
    and how many enabled drives had no new target when it came (k,)."""

    sync_s: Array
    target_s: Array
    missed: Array


class LightDrive:
    """One drive: ideal in operation, simulated in everything else."""

    def __init__(self, drive: SimulatedCia402, fastest: float) -> None:
        """`fastest`, increments/s: after a missed target it does not jump."""
        self.drive = drive
        self._fastest = fastest
        self._sync_s = -1.0
        self.frames = drive.frames
        self._word = -1
        self._target = self._position = self._status = 0
        self._is_new = False
        self.is_on = False

    def on_target(self, now_s: float, data: bytes) -> None:
        """Process data: a changed control word is the simulated drive's affair."""
        word, self._target = TARGET.unpack(data)
        self._is_new = True
        if word != self._word:
            self._word = word
            self.is_on = False
            self.drive.on_frame(now_s, Frame(self.frames.rpdo, data))

    def on_sync(self, now_s: float) -> tuple[Frame | None, bool]:
        """Its answer, and whether it missed a target."""
        if self.is_on:
            missed, self._is_new = not self._is_new, False
            most = int(self._fastest * (now_s - self._sync_s))
            self._position += min(max(self._target - self._position, -most), most)
            self._sync_s = self.drive._data.sync_s = now_s
            return Frame(self.frames.tpdo, ANSWER.pack(self._status, self._position, 0)), missed
        answers = self.drive.on_frame(now_s, Frame(codec.SYNC_ID))
        self.is_on = self.drive.power is PowerState.OPERATION_ENABLED
        self._status, self._is_new = self.drive.status_word, False
        self._position, self._sync_s = self.drive.motion.actual("position", now_s), now_s
        return (answers[0][1] if answers else None), False


class Bench:
    """The drives of a rig file on as many sockets as it has buses."""

    def __init__(self, rig: RigFile, profiles: Profiles, paths: Sequence[Path]) -> None:
        simulated = SimulatedRig(rig, profiles)
        # The bus side is what is measured: the mechanics behind it stand still and cost nothing.
        simulated.plant.advance = lambda to_s: None  # type: ignore[method-assign]
        simulated.plant.set_setpoint = lambda i, value, at_s: None  # type: ignore[method-assign]
        drives = [d for d in simulated.drives if isinstance(d, SimulatedCia402)]
        self._on_bus = [
            [
                LightDrive(d, a.velocity_max * a.drive.counts_per_unit)
                for d, a in zip(drives, rig.actuators, strict=True)
                if a.drive.bus == k
            ]
            for k in range(len(paths))
        ]
        self._by_target = [{d.frames.rpdo: d for d in drives} for drives in self._on_bus]
        self._listening = [_listen(path) for path in paths]
        self._ports: list[SocketPort] = []
        self._sync_s, self._target_s = np.full(MOST, np.nan), np.full(MOST, np.nan)
        self._missed = np.zeros(MOST)
        self._n = 0
        self._start_s = time.monotonic()

    def serve(self, told: Connection) -> None:
        """Be the drives until the other side of `told` says so; then send what was seen."""
        for sock in self._listening:
            theirs, _ = sock.accept()
            self._ports.append(SocketPort("bench", theirs, read_only=False, remedy="end"))
        poll = select.poll()
        for fd in (told.fileno(), *(p.fileno() for p in self._ports)):
            poll.register(fd, select.POLLIN)
        tidy_s = 0.0
        gone = False
        while not told.poll(TIDY_S if gone else 0.0):
            if gone:
                continue
            poll.poll(1000.0 * TIDY_S)
            try:
                for bus, port in enumerate(self._ports):
                    self._receive(bus, port)
                if time.monotonic() > tidy_s:
                    tidy_s = time.monotonic() + TIDY_S
                    self._tidy()
            except BusError:
                gone = True  # the master has left
        n = self._n
        told.send(Seen(self._sync_s[:n], self._target_s[:n], self._missed[:n]))

    def _receive(self, bus: int, port: SocketPort) -> None:
        for t_s, frame in port.receive():
            now_s = t_s - self._start_s
            light = self._by_target[bus].get(frame.can_id)
            if light is not None:
                light.on_target(now_s, frame.data)
                self._target_s[self._n - 1] = t_s
            elif frame.can_id == codec.SYNC_ID:
                self._on_sync(bus, port, t_s)
            else:
                for each in self._on_bus[bus]:
                    for _, answer in each.drive.on_frame(now_s, frame):
                        self._send(port, answer)

    def _on_sync(self, bus: int, port: SocketPort, t_s: float) -> None:
        if bus == 0 and self._n < MOST:
            self._sync_s[self._n] = t_s
            self._n += 1
        for light in self._on_bus[bus]:
            answer, missed = light.on_sync(t_s - self._start_s)
            self._missed[self._n - 1] += missed
            if answer is not None:
                self._send(port, answer)

    def _tidy(self) -> None:
        now_s = time.monotonic() - self._start_s
        for drives, port in zip(self._on_bus, self._ports, strict=True):
            for light in drives:
                for _, frame in light.drive.on_time(now_s):
                    self._send(port, frame)

    @staticmethod
    def _send(port: SocketPort, frame: Frame) -> None:
        with suppress(
            BusBusy
        ):  # a master that does not read in time loses what a controller would, too
            port.send(frame)


def be_drives(rig: RigFile, profiles: Profiles, paths: Sequence[Path], told: Connection) -> None:
    """A process of its own."""
    bench = Bench(rig, profiles, paths)
    request_fifo(PRIORITY - 10)
    told.send("here")
    bench.serve(told)


def _listen(path: Path) -> socket.socket:
    sock = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    sock.bind(str(path))
    sock.listen()
    return sock
