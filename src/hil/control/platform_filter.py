"""The low-pass filter with delay that some platforms put between the motion asked for and their controller.

H(s) = exp(-τ s) / (1 + s/ω)², ω = 2π f, the same in every coordinate ("Towards Simulating a Mid-size
Stewart Platform on a Large Hexapod Simulator", (1): f = 10 Hz is printed, τ = 35 ms is read from its
text and figure 2 [R]). Its impulse response ω² t exp(-ω t) is positive and its area is 1: pose, velocity
and acceleration that come out are weighted means of those that went in, so the limits that shaping
kept are kept behind it too.
"""

from __future__ import annotations

import math
from collections import deque
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

from hil.config import PlatformFilterSettings
from hil.control.reference import Reference

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]

REST_POSE: Final = 1.0e-5
REST_VELOCITY: Final = 1.0e-5
REST_ACCELERATION: Final = 1.0e-3
"""As shaping's own: nobody feels what is below, m or rad, /s, /s²."""


class PlatformFilter:
    """Filters the references of one rig, one a bus cycle, exactly: no approximation of the delay.

    Between two references the motion is the cubic through their poses and velocities. The delay is a
    whole number of cycles, kept as a queue, and a part of a cycle: the output is the filter's state
    inside the cycle that the delay points at.
    """

    def __init__(self, settings: PlatformFilterSettings, n: int, cycle_s: float) -> None:
        """Filter for n coordinates stepped every `cycle_s`; at rest in zero until `reset`."""
        whole = math.floor(settings.delay / cycle_s + 1.0e-9)
        part_s = max(settings.delay - whole * cycle_s, 0.0)
        omega = 2.0 * math.pi * settings.frequency
        # State y, dy/dt, then the input u with its three derivatives: d/dt of all is linear.
        system = np.diag([1.0, 0.0, 1.0, 1.0, 1.0], k=1)
        system[1, :3] = -omega * omega, -2.0 * omega, omega * omega
        self._cycle_s = cycle_s
        self._acceleration = system[1]
        self._to_output = expm(system * (cycle_s - part_s))
        self._over_cycle = expm(system * cycle_s)
        self._knots: deque[tuple[Vector, Vector]] = deque(maxlen=whole + 2)
        self.reset(np.zeros(n))

    def reset(self, pose: Vector) -> None:
        """Rest at `pose` (n,): nothing is on its way any more."""
        still = np.zeros_like(pose, dtype=np.float64)
        for _ in range(self._knots.maxlen or 0):
            self._knots.append((np.array(pose, dtype=np.float64), still))
        self._state = np.stack([np.asarray(pose, dtype=np.float64), still])
        self._output = np.stack([self._state[0], still, still])

    @property
    def at_rest(self) -> bool:
        """Whether what comes out rests, and nothing that still is on its way will move it."""
        pose, velocity, acceleration = self._output
        return (
            bool(np.all(np.abs(velocity) < REST_VELOCITY))
            and bool(np.all(np.abs(acceleration) < REST_ACCELERATION))
            and all(bool(np.all(np.abs(p - pose) < REST_POSE)) for p, _ in self._knots)
        )

    def step(self, reference: Reference) -> Reference:
        """The filtered motion at `reference.t_s`; `reference` is one cycle after the one before."""
        self._knots.append((reference.pose, reference.velocity))
        (p0, v0), (p1, v1) = self._knots[0], self._knots[1]
        h = self._cycle_s
        second = 6.0 * (p1 - p0) / h**2 - (4.0 * v0 + 2.0 * v1) / h
        third = 6.0 * (v0 + v1) / h**2 - 12.0 * (p1 - p0) / h**3
        start = np.stack([*self._state, p0, v0, second, third])
        now = self._to_output @ start
        self._state = (self._over_cycle @ start)[:2]
        pose, velocity, acceleration = now[0], now[1], self._acceleration @ now
        self._output = np.stack([pose, velocity, acceleration])
        return Reference(reference.t_s, pose, velocity, acceleration, reference.limited)
