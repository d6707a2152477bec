"""A road that rises and falls: what it makes of a ride, and what a ride says of it.

Roads that pass for level differ in slope by a few thousandths from here to there. A bicycle on a slope is
pitched with it: gravity stands in the acceleration along, and what turns about the vertical in the roll rate.
Neither is a fault, and no sensor tells it apart; but a road's slope changes over tens of metres, more slowly
than a fork dives or a rider brakes. So the slope that the acceleration along asks for, smooth over that way,
goes into the twin as part of what was ridden.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve

from hil.gap.bicycle.problem import RideProblem
from hil.gap.floor.noise import NoiseModel

Array = NDArray[np.float64]

ALONG: Final = "imu.accel_x"
SLOPE: Final = 4e-3
"""Standard deviation of a road's slope [R]."""
WAY_M: Final = 20.0
"""Over which it keeps [R]: at 5 m/s a hill of four seconds."""
LEVEL: Final = 3e-3
"""rad: of a whole ride's road, and what a mounting and a bias are off by [R]."""
TOGETHER_S: Final = 0.4
"""Time within which what is left of an acceleration, less the road, is one sample and not several [R]."""
CLEAR: Final = 8.0
"""Nats by which a sloping road must explain the acceleration along better than a level one [set on healthy
rides of two worlds]."""


def slopes_of(
    problem: RideProblem, noise: NoiseModel, vector: Array, residual: Array
) -> list[Array]:
    """(N,) slope of each ride's road on its grid, rad, uphill positive; none where they may all be level.

    `residual` (M,) is what the twin left of `problem` at `vector`, `noise` its floor.
    """
    sigma = noise.floor(problem).get(ALONG)
    if sigma is None:
        return []
    found, nats, values = [], 0.0, problem.values(vector)
    for k, twin in enumerate(problem.twins):
        (part,) = [x.part for x in problem.series if x.signal == ALONG and x.stretch == k]
        t, rows, g = twin.recorded.t_s, twin.judged, twin.rig.mass.gravity
        way = np.cumsum(np.abs(np.gradient(twin.recorded.angles[:, 1]))) * twin.rig.geometry.R
        tilt = residual[part] / g
        heading = twin.motion(values).q[:, 2]
        alike = _alike(way[rows], heading[rows])
        slope, gain = _smooth(alike, tilt, t[rows], sigma / g)
        found.append(np.interp(t, t[rows], slope))
        nats += gain
    mean = float(np.mean(np.concatenate(found)))  # as if the sensor were turned so much
    return [slope - mean for slope in found] if nats > CLEAR else []


def _alike(way_m: Array, heading: Array) -> Array:
    """(J, J) covariance of the slope at places along the way that are ridden in such directions: of hills
    over WAY_M, and of a field that falls one way."""
    apart = (way_m[:, None] - way_m[None, :]) / WAY_M
    turned = heading[:, None] - heading[None, :]
    return np.asarray(SLOPE**2 * (np.exp(-0.5 * apart**2) + np.cos(turned)))


def _smooth(road: Array, tilt: Array, t_s: Array, sigma_rad: float) -> tuple[Array, float]:
    """(J,) part of a tilt (J,) that a road of covariance `road` (J, J) makes, and how many nats its changes
    are worth."""
    together = max(TOGETHER_S / float(np.median(np.diff(t_s))), 1.0)
    left = max(sigma_rad, 1.4826 * float(np.median(np.abs(np.diff(tilt)))) / np.sqrt(2.0))
    noise = together * left**2 * np.eye(len(tilt))
    level = noise + LEVEL**2
    both = cho_factor(level + road, lower=True)
    alone = cho_factor(level, lower=True)
    weighed = cho_solve(both, tilt)
    nats = 0.5 * float(tilt @ cho_solve(alone, tilt) - tilt @ weighed)
    nats += float(np.sum(np.log(np.diag(alone[0]))) - np.sum(np.log(np.diag(both[0]))))
    return (road + LEVEL**2) @ weighed, nats
