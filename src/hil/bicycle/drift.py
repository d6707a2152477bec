"""Why a computed path does not end where the ride ended: integration, or biases of the sensors?

A path follows from relative measurements, so it can only drift. How far each cause moves its end is
computed, not guessed: the ride is integrated ten times finer through the same samples, and simulated with
one step of the steer encoder, a degree of lean and a percent of wheel radius more.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from hil.rigs.bicycle import Motion, Packed, Smooth, ride, smooth

Array = NDArray[np.float64]

FINER: Final = 10
STEER_STEP: Final = 2.0 * np.pi / 2400.0
DEGREE: Final = np.pi / 180.0
NEAR_M: Final = 0.01
"""An end so near the start leaves nothing to close: a bicycle that stood has it with any bias."""


@dataclass(frozen=True, slots=True)
class Drift:
    """How far the path's end moves (m, by x and y) for each cause."""

    end: Array
    """(2,) where the path ends from where it began, m."""
    heading: float
    """At the end against the start, rad, within ±pi."""
    integration: Array
    """(2,) what the integration rule moved the end by."""
    steer_step: Array
    """(2,) for one step of the steer encoder, 0.15 degrees."""
    lean_degree: Array
    """(2,) for a degree of lean."""
    radius_percent: Array
    """(2,) for one percent of wheel radius."""
    closing_steer: float | None
    """Steer bias (rad) that takes the end nearest to the start; None where no small one does."""
    closing_gap: float
    """Distance (m) between end and start with that."""

    def numbers(self) -> dict[str, Any]:
        """For people and scripts."""
        return {
            "end_m": [float(v) for v in self.end],
            "end_distance_m": float(np.hypot(*self.end)),
            "heading": self.heading,
            "integration_m": float(np.hypot(*self.integration)),
            "steer_bias_one_step_m": float(np.hypot(*self.steer_step)),
            "lean_bias_one_degree_m": float(np.hypot(*self.lean_degree)),
            "wheel_radius_one_percent_m": float(np.hypot(*self.radius_percent)),
            "closing_steer_bias": self.closing_steer,
            "closing_gap_m": self.closing_gap,
        }


def find_drift(
    bicycle: Packed, angles: Array, dt_s: float, cutoff_hz: float, order: int, motion: Motion
) -> Drift:
    """Split the drift of the ride of `angles` (N, 3), whose motion is known already.

    What moves the end is computed of rigid rides against a rigid one: `motion` may have a fork that gives.
    """
    told = smooth(angles, dt_s, cutoff_hz, order)
    rigid = ride(bicycle, told).q[-1, :2]

    def moved(steer: float = 0.0, lean: float = 0.0, radius: float = 1.0) -> Array:
        told = smooth(angles + np.array([lean, 0.0, steer]), dt_s, cutoff_hz, order)
        return np.asarray(ride(bicycle.scaled(radius, radius), told).q[-1, :2] - rigid)

    there = motion.q[-1, :2]
    t = dt_s * np.arange(len(angles))
    fine = dt_s / FINER * np.arange((len(angles) - 1) * FINER + 1)
    spline = CubicSpline(t, told.angle)
    finer = Smooth(dt_s / FINER, spline(fine), spline(fine, 1), spline(fine, 2))
    coarse_of_same = ride(bicycle, Smooth(dt_s, told.angle, spline(t, 1), spline(t, 2)))
    integration = coarse_of_same.q[-1, :2] - ride(bicycle, finer).q[-1, :2]
    one = moved(steer=STEER_STEP)
    closing, gap = _closing(lambda bias: there + moved(steer=bias), there, one)
    heading = float(np.arctan2(np.sin(motion.q[-1, 2]), np.cos(motion.q[-1, 2])))
    return Drift(
        there - motion.q[0, :2],
        heading,
        integration,
        one,
        moved(lean=DEGREE),
        moved(radius=1.01),
        closing,
        gap,
    )


def _closing(end: Callable[[float], Array], there: Array, one: Array) -> tuple[float | None, float]:
    """Gauss-Newton on the steer bias alone; two numbers cannot both be closed by one, hence the gap left."""
    if np.hypot(*there) < NEAR_M:
        return None, float(np.hypot(*there))
    bias, at, slope = 0.0, there, one / STEER_STEP
    for _ in range(6):
        size = float(slope @ slope)
        if size == 0.0:
            return None, float(np.hypot(*at))
        step = -float(slope @ at) / size
        step = float(np.clip(step, -10.0 * STEER_STEP, 10.0 * STEER_STEP))
        bias += step
        at = end(bias)
        slope = (end(bias + 0.1 * STEER_STEP) - at) / (0.1 * STEER_STEP)
        if abs(step) < 0.01 * STEER_STEP:
            break
    gap = float(np.hypot(*at))
    better = gap < 0.5 * float(np.hypot(*there))
    return (
        (bias, gap) if better and abs(bias) < 40.0 * STEER_STEP else (None, float(np.hypot(*there)))
    )
