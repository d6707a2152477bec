"""One rig of the exam as it really is, in arrays, and the errors of its sensors, clocks and bus."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from hil.config import RigFile

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Outside:
    """An effect that no catalogue names: kind, place, numbers."""

    kind: str
    location: str
    parameters: dict[str, float]


@dataclass(slots=True)
class Sensor:
    """What stands between a true value and its answer, beside the rig file's noise."""

    bias: float = 0.0
    scale: float = 1.0
    latency_s: float = 0.0
    step: float = 0.0


@dataclass(slots=True)
class World:
    """The arrays that `kernel.simulate` takes, and the errors of sensors, clocks and bus.

    Build with `build_world`. `setpoint_delay_s` and `answer_delay_s` (n,) hold the scattered delays.
    """

    rig: RigFile
    head: Array
    act: Array
    true: tuple[Array, Array, Array]
    nominal: tuple[Array, Array, Array, Array]
    legs: Array
    imu: Array
    setpoint_delay_s: Array
    answer_delay_s: Array
    noise_share: Array
    sensors: dict[str, Sensor] = field(default_factory=dict)
    clocks: dict[str, float] = field(default_factory=dict)
    lost: dict[str, float] = field(default_factory=dict)

    def sensor(self, signal: str) -> Sensor:
        """The sensor errors of a signal, to be changed."""
        return self.sensors.setdefault(signal, Sensor())


def add_point_mass(body: Array, mass_kg: float, place: Array) -> None:
    """Bolt a mass to `body` (mass, cog, tensor about it), in place."""
    m, cog = body[0], np.array(body[1:4])
    arm = place - cog
    spread = m * mass_kg / (m + mass_kg) * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    body[0] = m + mass_kg
    body[1:4] = cog + arm * mass_kg / (m + mass_kg)
    body[4:10] += spread[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]
