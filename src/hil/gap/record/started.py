"""When the clocks started by which drives play their setpoints: the first frame starts each, late as it came.

A drive that plays setpoints by its own clock hears no jitter, but all of a run is as late as its first frame
was. No stamp tells that, and a tenth of a millisecond is tens of micrometres at full speed: a hundred floors
of a fine encoder.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hil.bus.load import RECKONED_BITS
from hil.gap.record.fineness import CLEARER
from hil.gap.record.problem import Problem
from hil.gap.record.ticks import Ticks

Array = NDArray[np.float64]

ENOUGH: Final = 12
"""Samples of a position from which on it tells anything."""
APART_S: Final = 4e-5
"""By how much starts must lie apart to be told: friction and masses that are a little off lag by less [R]."""
TOLD_S: Final = 1e-4
"""Spread, over the speed's, of what else a position is off by, up to which it tells of a start [R]."""


def started(problem: Problem, vector: Array) -> dict[tuple[int, str], Ticks]:
    """How late each drive's own clock was started: by the wait of the first frame, for those of all drives at
    most and one. Which setpoint is played when jumps with it, so no slope leads there: all are tried, and the
    earliest is taken that no other is clearly better than.

    What is left of that from stretch to stretch shows in the positions.
    """
    rig = problem.rig
    names = rig.actuator_names
    frame_s = RECKONED_BITS / rig.can.bitrate
    tried = np.arange(0.0, (len(names) + 1) * frame_s + 1e-9, frame_s)
    keys = [(k, a) for k, p in enumerate(problem.pieces) if p.mode == "position" for a in names]
    sizes = {key: np.full(len(tried), np.inf) for key in keys}
    for d, late_s in enumerate(tried):
        clocks = {key: Ticks(0.0, 0.0, 0.0, float(late_s)) for key in keys}
        left = problem.with_clocks(clocks).residual(vector)
        for x in problem.series:
            if x.quantity == "force" and (x.stretch, x.actuator) in sizes:
                kept = problem.kept[x.part]
                middle = float(np.median(np.abs(left[x.part][kept]))) if kept.any() else np.inf
                sizes[x.stretch, x.actuator][d] = middle
    found = {}
    for key, size in sizes.items():
        if np.isfinite(size).all():
            as_good = np.log(size + 1e-300) < np.log(size.min() + 1e-300) + CLEARER
            found[key] = Ticks(0.0, 0.0, 0.0, float(tried[np.argmax(as_good)]))
    return _apart(problem, found, vector, float(tried[-1]))


def _apart(
    problem: Problem, found: Mapping[tuple[int, str], Ticks], vector: Array, most_s: float
) -> dict[tuple[int, str], Ticks]:
    """The same starts, each later by what positions of its stretch lag behind those of the drive's earliest,
    `most_s` at most: what all stretches lag by is a delay, and no start, and neither is what is more."""
    left = problem.with_clocks(found).residual(vector)
    lags: dict[str, dict[int, float]] = {}
    for x in problem.series:
        if x.quantity == "position" and (x.stretch, x.actuator) in found:
            lag_s = _lag_s(problem.t_s[x.part], problem.measured[x.part], left[x.part])
            if lag_s is not None:
                lags.setdefault(x.actuator, {})[x.stretch] = lag_s
    out = dict(found)
    for a, by_stretch in lags.items():
        least = min(by_stretch.values())
        if APART_S < max(by_stretch.values()) - least < most_s + APART_S:
            for k, lag_s in by_stretch.items():
                out[k, a] = replace(found[k, a], late_s=found[k, a].late_s + lag_s - least)
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
