"""The rig that is not there: one plant behind simulated drives and an IMU, fed by frames and time.

Pure: the deterministic world drives it in simulated time, `hil simulate` in real time.
"""

from __future__ import annotations

import heapq
from collections.abc import Sequence

import numpy as np

from hil.config import Effect, RigFile
from hil.drives.profile import LustProfile
from hil.drives.profiles import Profiles
from hil.frames import Frame
from hil.sim.cia402.drive import SimulatedCia402
from hil.sim.imu_node import SimulatedImu
from hil.sim.lust.drive import SimulatedCdd3000
from hil.sim.plant import Plant


class SimulatedRig:
    """Plant, drives and IMU of a rig file; `profiles` by the names that the rig file uses; `hidden`
    effects are those that its file does not know of."""

    def __init__(
        self, rig: RigFile, profiles: Profiles, seed: int = 0, hidden: Sequence[Effect] = ()
    ) -> None:
        streams = np.random.default_rng(seed).spawn(len(rig.actuators) + 1)
        self.plant = Plant(rig, seed=seed, hidden=hidden)
        self.drives = [
            _drive(rig, i, self.plant, profiles, streams[i]) for i in range(len(rig.actuators))
        ]
        self._buses = [a.drive.bus for a in rig.actuators]
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
        """A frame arrives at every drive of its bus, as on a real one."""
        for drive, bus in zip(self.drives, self._buses, strict=True):
            if bus == frame.bus:
                self._queue(drive.on_frame(now_s, frame), bus)
        self.next_due_s = self._due_s()

    def on_time(self, now_s: float) -> list[Frame]:
        """The frames that leave the rig's nodes up to `now_s`, in order."""
        for drive, bus in zip(self.drives, self._buses, strict=True):
            if drive.next_due_s <= now_s:
                self._queue(drive.on_time(now_s), bus)
        if self.imu is not None and self.imu.next_due_s <= now_s:
            self._queue(self.imu.on_time(now_s), 0)
        out = []
        while self._pending and self._pending[0][0] <= now_s:
            out.append(heapq.heappop(self._pending)[2])
        self.next_due_s = self._due_s()
        return out

    def _queue(self, frames: Sequence[tuple[float, Frame]], bus: int) -> None:
        for at_s, sent in frames:
            frame = sent._replace(bus=bus) if bus else sent
            heapq.heappush(self._pending, (at_s, self._order, frame))
            self._order += 1


def _drive(
    rig: RigFile, i: int, plant: Plant, profiles: Profiles, rng: np.random.Generator
) -> SimulatedCdd3000 | SimulatedCia402:
    profile = profiles[rig.actuators[i].drive.profile]
    if isinstance(profile, LustProfile):
        return SimulatedCdd3000(rig, i, plant, profile, rng)
    return SimulatedCia402(rig, i, plant, profile, rng)
