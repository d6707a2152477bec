"""Shares, medians and calibration with their uncertainty: every mark has a 95 % interval."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

Z: Final = 1.959963984540054
RESAMPLES: Final = 1000
BINS: Final = 10


@dataclass(frozen=True, slots=True)
class Value:
    """A mark's value over `count` cases; None where there is nothing to count."""

    value: float | None
    low: float | None
    high: float | None
    count: int


NOTHING: Final = Value(None, None, None, 0)


def share(hits: Sequence[bool]) -> Value:
    """Share of hits with Wilson's interval [M: Wilson 1927]: it holds for few cases and near 0 and 1 too."""
    n = len(hits)
    if n == 0:
        return NOTHING
    p = sum(hits) / n
    middle = (p + Z**2 / (2.0 * n)) / (1.0 + Z**2 / n)
    half = Z / (1.0 + Z**2 / n) * math.sqrt(p * (1.0 - p) / n + Z**2 / (4.0 * n * n))
    return Value(p, max(middle - half, 0.0), min(middle + half, 1.0), n)


def resampled(rows: Array, statistic: Callable[[Array], float]) -> Value:
    """`statistic` of rows (N, ...) with the interval of resampled rows (percentiles of the bootstrap)."""
    n = len(rows)
    if n == 0:
        return NOTHING
    value = float(statistic(rows))
    if n == 1:
        return Value(value, None, None, 1)
    rng = np.random.default_rng(0)
    drawn = [float(statistic(rows[rng.integers(n, size=n)])) for _ in range(RESAMPLES)]
    low, high = np.quantile(drawn, [0.025, 0.975], method="inverted_cdf")
    return Value(value, float(low), float(high), n)


def median(values: Sequence[float]) -> Value:
    """Median with its bootstrap interval."""
    return resampled(np.asarray(values, dtype=float), lambda x: float(np.median(x)))


def mean(values: Sequence[float]) -> Value:
    """Mean with its bootstrap interval."""
    return resampled(np.asarray(values, dtype=float), lambda x: float(np.mean(x)))


def brier(stated: Sequence[float], came: Sequence[bool]) -> Value:
    """Mean squared difference of stated probability and what came (0 or 1)."""
    rows = np.column_stack([np.asarray(stated, dtype=float), np.asarray(came, dtype=float)])
    return resampled(rows, lambda x: float(np.mean((x[:, 0] - x[:, 1]) ** 2)))


def calibration_error(stated: Sequence[float], came: Sequence[bool]) -> Value:
    """Expected calibration error: |stated - came| of each tenth of probability, weighed by its cases."""
    rows = np.column_stack([np.asarray(stated, dtype=float), np.asarray(came, dtype=float)])
    return resampled(rows, _ece)


def reliability(stated: Sequence[float], came: Sequence[bool]) -> list[dict[str, float]]:
    """For each tenth of probability that holds cases: bounds, mean stated, share that came and interval."""
    p, y = np.asarray(stated, dtype=float), np.asarray(came, dtype=bool)
    out = []
    for k, inside in enumerate(_bins(p)):
        if inside.any():
            found = share(y[inside].tolist())
            out.append(
                {
                    "from": k / BINS,
                    "to": (k + 1) / BINS,
                    "count": int(inside.sum()),
                    "stated": float(p[inside].mean()),
                    "came": found.value or 0.0,
                    "low": found.low or 0.0,
                    "high": found.high or 0.0,
                }
            )
    return out


def _bins(p: Array) -> list[NDArray[np.bool_]]:
    at = np.minimum((p * BINS).astype(np.int64), BINS - 1)
    return [at == k for k in range(BINS)]


def _ece(rows: Array) -> float:
    total = 0.0
    for inside in _bins(rows[:, 0]):
        if inside.any():
            total += inside.mean() * abs(rows[inside, 0].mean() - rows[inside, 1].mean())
    return float(total)
