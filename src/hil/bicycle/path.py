"""The path that a simulated ride follows, and how fast: out, round, back, round, stop."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
SPACING_M: Final = 0.05


@dataclass(frozen=True, slots=True)
class Path:
    """Rows every SPACING_M along the path: x, y (m), heading (rad, unwrapped), curvature (1/m)."""

    rows: Array
    pace: Array | None = None
    """(N,) share of the rider's speed that is ridden there; everywhere all of it where missing."""

    @property
    def length_m(self) -> float:
        """Of the whole path."""
        return SPACING_M * (len(self.rows) - 1)


def u_turns(straight_m: float = 50.0, radius_m: float = 6.0, ease_m: float = 4.0) -> Path:
    """A straight, a U-turn to the left, back, another U-turn, ending where and as it began.

    Curvature comes and goes over `ease_m`, as a rider's does.
    """
    turn_m = np.pi * radius_m + ease_m
    run_m = 10.0  # after the second turn, to brake: the ride ends where it began
    lap = [(0.0, straight_m), (1.0, turn_m), (0.0, straight_m + run_m), (1.0, turn_m), (0.0, run_m)]
    ends = np.cumsum([0.0, *(length for _, length in lap)])
    s = np.arange(0.0, ends[-1], SPACING_M)
    curvature = np.zeros(len(s))
    for (turning, _), start, end in zip(lap, ends, ends[1:], strict=False):
        inside = (s >= start) & (s < end)
        eased = np.minimum((s[inside] - start) / ease_m, (end - s[inside]) / ease_m)
        curvature[inside] = turning * np.clip(eased, 0.0, 1.0) / radius_m
    return _along(s, curvature)


def slalom(length_m: float = 100.0, period_m: float = 18.0, radius_m: float = 9.0) -> Path:
    """Straight with a slalom in between: another family of rides, for data that no fit has seen."""
    s = np.arange(0.0, length_m, SPACING_M)
    share = np.clip(np.minimum(s - 15.0, length_m - 15.0 - s) / period_m, 0.0, 1.0)
    return _along(s, share * np.sin(2.0 * np.pi * (s - 15.0) / period_m) / radius_m)


def surges(length_m: float = 90.0, period_m: float = 22.0, slowest: float = 0.45) -> Path:
    """Straight on, faster and slower in turn: load goes from wheel to wheel and back."""
    s = np.arange(0.0, length_m, SPACING_M)
    wave = 0.5 + 0.5 * np.cos(2.0 * np.pi * (s - 8.0) / period_m)
    pace = slowest + (1.0 - slowest) * np.where(s < 8.0, 1.0, wave)
    return Path(_along(s, np.zeros(len(s))).rows, pace)


def eight(radius_m: float = 6.0, ease_m: float = 4.0, straight_m: float = 10.0) -> Path:
    """A circle to the left, one to the right."""
    circle_m = 2.0 * np.pi * radius_m + ease_m
    s = np.arange(0.0, 2.0 * (straight_m + circle_m), SPACING_M)
    curvature = np.zeros(len(s))
    for side, start in ((1.0, straight_m), (-1.0, straight_m + circle_m)):
        inside = (s >= start) & (s < start + circle_m)
        there = s[inside] - start
        eased = np.clip(np.minimum(there, circle_m - there) / ease_m, 0.0, 1.0)
        curvature[inside] = side * eased / radius_m
    return _along(s, curvature)


def _along(s: Array, curvature: Array) -> Path:
    heading = np.cumsum(curvature) * SPACING_M
    x = np.cumsum(np.cos(heading)) * SPACING_M
    y = np.cumsum(np.sin(heading)) * SPACING_M
    return Path(np.column_stack([x - x[0], y - y[0], heading, curvature]))


def speed_profile(
    path: Path,
    dt_s: float,
    cruise: float = 5.0,
    turning: float = 3.6,
    rest_s: float = 1.5,
    vigour: float = 1.0,
) -> Array:
    """(N, 2) speed (m/s) and acceleration (m/s2) over time: rest, ride, slow for turns, brake, rest.

    `vigour`: of pulling away (1 m/s2) and braking (1.6 m/s2), as a factor.
    """
    v, a = _envelope(path, cruise, turning, vigour)
    out = [np.zeros((round(rest_s / dt_s), 2))]
    ridden, speed, rows = 0.0, 0.0, []
    while ridden < path.length_m - 0.3:
        k = min(int(ridden / SPACING_M), len(v) - 1)
        fresh = max(float(v[k]), 0.3)
        rows.append((fresh, float(a[k])))
        speed = fresh
        ridden += speed * dt_s
    out += [np.array(rows), np.zeros((round(rest_s / dt_s), 2))]
    return np.concatenate(out)


def _envelope(path: Path, cruise: float, turning: float, vigour: float) -> tuple[Array, Array]:
    """Speed by distance under limits of acceleration, rounded off, and its acceleration."""
    limit = np.where(np.abs(path.rows[:, 3]) > 1e-3, turning, cruise)
    if path.pace is not None:
        limit = limit * path.pace
    squared = limit**2
    squared[0] = squared[-1] = 0.0
    for k in range(1, len(limit)):
        squared[k] = min(squared[k], squared[k - 1] + 2.0 * vigour * SPACING_M)
    for k in range(len(limit) - 2, -1, -1):
        squared[k] = min(squared[k], squared[k + 1] + 3.2 * vigour * SPACING_M)
    width = round(1.0 / SPACING_M)
    padded = np.pad(squared, width, mode="edge")
    soft = np.convolve(padded, np.hanning(2 * width + 1) / np.hanning(2 * width + 1).sum(), "valid")
    return np.sqrt(soft), 0.5 * np.gradient(soft, SPACING_M)
