"""Objective rating of one curve against another after ISO/TS 18571: corridor, phase, magnitude, slope.

For readers who have to report it: it rates likeness, and knows no noise floor and no cause. Constants and
formulas are the specification's [M]: corridors of 5 % and 50 % of the largest value; shifts up to 20 % of the
time; dynamic time warping within 10 % of it; slopes over nine samples; weights 0.4, 0.2, 0.2, 0.2.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hil.errors import IdentificationError

Array = NDArray[np.float64]

INNER: Final = 0.05
OUTER: Final = 0.5
LONGEST_SHIFT: Final = 0.2
WARP: Final = 0.1
MAGNITUDE: Final = 0.5
SLOPE: Final = 2.0
SMOOTH: Final = 9
FEWEST: Final = 50
MOST: Final = 1000
"""Samples; longer records are thinned to it, or the warping would take minutes."""
GRADES: Final = ((0.94, "excellent"), (0.8, "good"), (0.58, "fair"), (-1.0, "poor"))


@dataclass(frozen=True, slots=True)
class Rating:
    """Scores between 0 and 1; identical curves score 1 in each."""

    corridor: float
    phase: float
    magnitude: float
    slope: float

    @property
    def overall(self) -> float:
        """The weighted mean."""
        return 0.4 * self.corridor + 0.2 * (self.phase + self.magnitude + self.slope)

    @property
    def grade(self) -> str:
        """excellent, good, fair or poor."""
        return next(word for least, word in GRADES if self.overall > least)


def rate(t_s: Array, reference: Array, other: Array) -> Rating:
    """Rate `other` (N,) against `reference` (N,), both sampled at `t_s` (N,), s, rising.

    Unevenly sampled curves are brought to an even grid first. IdentificationError where there are too few
    samples, or the reference is zero throughout.
    """
    if len(t_s) < FEWEST:
        raise IdentificationError(f"{len(t_s)} samples are too few to rate; {FEWEST} are needed")
    if not np.any(np.abs(reference) > 0.0):
        raise IdentificationError("a curve that is zero throughout cannot be rated against")
    grid = np.linspace(t_s[0], t_s[-1], min(len(t_s), MOST))
    told, twin = np.interp(grid, t_s, reference), np.interp(grid, t_s, other)
    corridor = _corridor(told, twin)
    shift = _best_shift(told, twin)
    n = len(grid)
    phase = max(0.0, 1.0 - abs(shift) / (LONGEST_SHIFT * n))
    a, b = _overlap(told, twin, shift)
    return Rating(corridor, phase, _magnitude(a, b, int(WARP * n)), _slope(a, b))


def _corridor(told: Array, twin: Array) -> float:
    top = float(np.max(np.abs(told)))
    d = np.abs(told - twin)
    inside = np.clip((OUTER * top - d) / ((OUTER - INNER) * top), 0.0, 1.0)
    return float(np.mean(inside**2))


def _overlap(told: Array, twin: Array, shift: int) -> tuple[Array, Array]:
    """Both where they overlap once `twin` has been moved earlier by `shift` samples."""
    n = len(told)
    if shift >= 0:
        return told[: n - shift], twin[shift:]
    return told[-shift:], twin[: n + shift]


def _best_shift(told: Array, twin: Array) -> int:
    """The shift with the largest correlation coefficient; of equals the smallest."""
    top = int(LONGEST_SHIFT * len(told))
    best, found = -np.inf, 0
    for shift in sorted(range(-top, top + 1), key=abs):
        a, b = _overlap(told, twin, shift)
        a, b = a - a.mean(), b - b.mean()
        scale = float(np.sqrt((a @ a) * (b @ b)))
        alike = float(a @ b) / scale if scale > 0.0 else 0.0
        if alike > best + 1e-12:
            best, found = alike, shift
    return found


def _magnitude(told: Array, twin: Array, window: int) -> float:
    path = _warp(told, twin, max(window, 1))
    error = float(np.sum(np.abs(told[path[:, 0]] - twin[path[:, 1]])))
    size = float(np.sum(np.abs(told[path[:, 0]])))
    return max(0.0, 1.0 - error / size / MAGNITUDE) if size > 0.0 else float(error == 0.0)


def _warp(told: Array, twin: Array, window: int) -> NDArray[np.int64]:
    """(K, 2) pairs of indices on the cheapest path, squares as cost, within a band about the diagonal."""
    n = len(told)
    costs = np.full((n + 1, n + 1), np.inf)
    costs[0, 0] = 0.0
    for i in range(1, n + 1):
        low, high = max(1, i - window), min(n, i + window)
        local = ((told[i - 1] - twin[low - 1 : high]) ** 2).tolist()
        above = np.minimum(costs[i - 1, low : high + 1], costs[i - 1, low - 1 : high]).tolist()
        left, row = float(costs[i, low - 1]), []
        for step, up in zip(local, above, strict=True):
            left = step + (up if up < left else left)
            row.append(left)
        costs[i, low : high + 1] = row
    i = j = n
    path = [(n - 1, n - 1)]
    while (i, j) != (1, 1):
        ways = (
            (costs[i - 1, j - 1], i - 1, j - 1),
            (costs[i - 1, j], i - 1, j),
            (costs[i, j - 1], i, j - 1),
        )
        _, i, j = min(ways, key=lambda way: way[0])
        path.append((i - 1, j - 1))
    return np.array(path[::-1])


def _slope(told: Array, twin: Array) -> float:
    kernel = np.full(SMOOTH, 1.0 / SMOOTH)
    a, b = (np.convolve(np.gradient(x), kernel, mode="valid") for x in (told, twin))
    size = float(np.sum(np.abs(a)))
    error = float(np.sum(np.abs(a - b)))
    return max(0.0, 1.0 - error / size / SLOPE) if size > 0.0 else float(error == 0.0)
