"""By how much setpoints act later in one stretch of a record than in another: positions tell.

A clock of a drive's own stands differently to that of the bus after each start, and no stamp tells how. What
all stretches lag by is a delay; what they lag by beyond each other, within a tick, is no property of the rig.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hil.gap.record.problem import Problem
from hil.gap.record.ticks import AtSync, Clocks, Key, Ticks

Array = NDArray[np.float64]

ENOUGH: Final = 12
"""Samples of a position from which on it tells anything."""
APART_S: Final = 4e-5
"""By how much stretches must lie apart to be told: friction and masses a little off lag by less [R]."""
TOLD_S: Final = 1e-4
"""Spread, over the speed's, of what else a position is off by, up to which it tells of that [R]."""


def apart(
    problem: Problem,
    found: Clocks,
    vector: Array,
    most_s: float,
    zero_of: Callable[[Iterable[float]], float],
) -> dict[Key, Ticks | AtSync]:
    """The clocks `found`, by stretch and actuator, each later by what positions of its stretch lag beyond
    `zero_of` the lags of its drive's stretches, s; where those lie further apart than `most_s`, as they are.

    `vector` (P,): the twin that they are looked at beside.
    """
    if len({k for k, _ in found}) < 2:
        return dict(found)
    left = problem.with_clocks(found).residual(vector)
    lags: dict[str, dict[int, float]] = {}
    for x in problem.series:
        if x.quantity == "position" and (x.stretch, x.actuator) in found:
            lag_s = _lag_s(problem.t_s[x.part], problem.measured[x.part], left[x.part])
            if lag_s is not None:
                lags.setdefault(x.actuator, {})[x.stretch] = lag_s
    out = dict(found)
    for a, by_stretch in lags.items():
        told = list(by_stretch.values())
        if APART_S < max(told) - min(told) < most_s + APART_S:
            for k, lag_s in by_stretch.items():
                out[k, a] = out[k, a].delayed(lag_s - float(zero_of(told)))
    return out


def _lag_s(t: Array, position: Array, left: Array) -> float | None:
    """By how much a position lags behind a twin that is `left` (M,) off; None where it hardly moves."""
    if len(t) < ENOUGH:
        return None
    speed = np.gradient(position, t)
    speed = speed - float(np.mean(speed))
    size = float(speed @ speed)
    lag_s = -float(left @ speed) / max(size, 1e-300)
    rest = left + lag_s * speed
    error_s = float(np.std(rest)) / max(np.sqrt(size / len(t)), 1e-300)
    return lag_s if error_s < TOLD_S else None
