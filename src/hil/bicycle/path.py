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


def _along(s: Array, curvature: Array) -> Path:
    heading = np.cumsum(curvature) * SPACING_M
    x = np.cumsum(np.cos(heading)) * SPACING_M
    y = np.cumsum(np.sin(heading)) * SPACING_M
    return Path(np.column_stack([x - x[0], y - y[0], heading, curvature]))


def speed_profile(
    path: Path, dt_s: float, cruise: float = 5.0, turning: float = 3.6, rest_s: float = 1.5
) -> Array:
    """(N, 2) speed (m/s) and acceleration (m/s2) over time: rest, ride, slow for turns, brake, rest."""
    v, a = _envelope(path, cruise, turning)
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


def _envelope(path: Path, cruise: float, turning: float) -> tuple[Array, Array]:
    """Speed by distance under limits of acceleration, rounded off, and its acceleration."""
    limit = np.where(np.abs(path.rows[:, 3]) > 1e-3, turning, cruise)
    squared = limit**2
    for order, pull in ((range(1, len(limit)), 1.0), (range(len(limit) - 2, -1, -1), 1.6)):
        start = 0 if pull == 1.0 else len(limit) - 1
        squared[start] = 0.0
        for k in order:
            before = squared[k - 1] if pull == 1.0 else squared[k + 1]
            squared[k] = min(squared[k], before + 2.0 * pull * SPACING_M)
    width = round(1.0 / SPACING_M)
    padded = np.pad(squared, width, mode="edge")
    soft = np.convolve(padded, np.hanning(2 * width + 1) / np.hanning(2 * width + 1).sum(), "valid")
    return np.sqrt(soft), 0.5 * np.gradient(soft, SPACING_M)
