"""The rig that is not there: one plant behind simulated drives and an IMU, fed by frames and time.

Pure: the deterministic world drives it in simulated time, `hil simulate` in real time.
"""

from __future__ import annotations

import heapq
from collections.abc import Mapping, Sequence

import numpy as np

from hil.config import RigFile
from hil.drives.profile import LustProfile
from hil.frames import Frame
from hil.sim.imu_node import SimulatedImu
from hil.sim.lust import SimulatedCdd3000
from hil.sim.plant import Plant


class SimulatedRig:
    """Plant, drives and IMU of a rig file; `profiles` by the names that the rig file uses."""

    def __init__(self, rig: RigFile, profiles: Mapping[str, LustProfile], seed: int = 0) -> None:
        streams = np.random.default_rng(seed).spawn(len(rig.actuators) + 1)
        self.plant = Plant(rig, seed=seed)
        self.drives = [
            SimulatedCdd3000(rig, i, self.plant, profiles[actuator.drive.profile], streams[i])
            for i, actuator in enumerate(rig.actuators)
        ]
        self.imu = SimulatedImu(rig, self.plant, streams[-1]) if rig.imu else None
        self._pending: list[tuple[float, int, Frame]] = []
        self._order = 0
        self.next_due_s = self._due_s()
        """Instant at which `on_time` has something to do, s."""

    def _due_s(self) -> float:
        due = [d.next_due_s for d in self.drives]
        if self.imu is not None:
            due.append(self.imu.next_due_s)
        if self._pending:
            due.append(self._pending[0][0])
        return min(due)

    def on_frame(self, now_s: float, frame: Frame) -> None:
        """A frame arrives at every drive, as on a real bus."""
        for drive in self.drives:
            self._queue(drive.on_frame(now_s, frame))
        self.next_due_s = self._due_s()

    def on_time(self, now_s: float) -> list[Frame]:
        """The frames that leave the rig's nodes up to `now_s`, in order."""
        for drive in self.drives:
            if drive.next_due_s <= now_s:
                self._queue(drive.on_time(now_s))
        if self.imu is not None and self.imu.next_due_s <= now_s:
            self._queue(self.imu.on_time(now_s))
        out = []
        while self._pending and self._pending[0][0] <= now_s:
            out.append(heapq.heappop(self._pending)[2])
        self.next_due_s = self._due_s()
        return out

    def _queue(self, frames: Sequence[tuple[float, Frame]]) -> None:
        for at_s, frame in frames:
            heapq.heappush(self._pending, (at_s, self._order, frame))
            self._order += 1
