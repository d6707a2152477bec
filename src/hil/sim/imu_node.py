"""The simulated IMU node: samples the plant at its own rate, adds noise, sends two frames."""

from __future__ import annotations

from typing import Final

import numpy as np

from hil.config import RigFile
from hil.drives.imu_node import encode
from hil.frames import Frame
from hil.sim.plant import Plant

PHASE: Final = 0.8
"""Of its period, from the start to the first sample: a sensor's clock knows nothing of the master's cycle,
and would only by chance send just when a cycle begins."""


class SimulatedImu:
    """A free-running node: nothing that is sent to it changes it."""

    def __init__(self, rig: RigFile, plant: Plant, rng: np.random.Generator) -> None:
        if rig.imu is None:
            raise ValueError("the rig file has no imu")
        self._plant = plant
        self._rng = rng
        self._base_id = rig.can.imu_base_id
        self._period_s = 1.0 / rig.imu.rate
        self._delay_s = rig.imu.delay
        noise = rig.noise
        self._sigma = np.repeat([noise.gyro, noise.accel], 3)
        self._step = np.repeat([noise.gyro_step, noise.accel_step], 3)
        self._counter = 0
        self.next_due_s = plant.now_s + PHASE * self._period_s

    def on_time(self, now_s: float) -> list[tuple[float, Frame]]:
        """The frames of every sample that is due, each with its send instant."""
        out: list[tuple[float, Frame]] = []
        while self.next_due_s <= now_s:
            at_s = self.next_due_s
            self._plant.advance(at_s)
            noise = self._sigma * self._rng.standard_normal(6)
            values = self._plant.imu_answer(at_s, noise)
            coarse = self._step > 0.0
            values[coarse] = np.round(values[coarse] / self._step[coarse]) * self._step[coarse]
            frames = encode(self._base_id, values[:3].tolist(), values[3:].tolist(), self._counter)
            out += [(at_s + self._delay_s, frame) for frame in frames]
            self._counter += 1
            self.next_due_s += self._period_s
        return out
