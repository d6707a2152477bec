"""Signals in steps coarser than the rig file says: seen in the values themselves, no twin needed."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from hil.gap.draws import sensor_noise
from hil.gap.problem import Problem

Array = NDArray[np.float64]

COARSER: Final = 1.8
"""Times the rig file's own step, or the noise, from which on steps are an effect."""
ON_GRID: Final = 0.99
OFF: Final = 0.03
"""Of a step, that a value may lie beside the grid."""


def coarse_steps(problem: Problem) -> dict[str, float]:
    """By signal, the step that its values keep to, where that is coarser than rig file and noise allow."""
    out = {}
    for signal in problem.signals:
        values = np.concatenate(
            [problem.measured[x.part] for x in problem.series if x.signal == signal]
        )
        quantity = signal.partition(".")[2].partition("_")[0]
        spread, own = sensor_noise(problem.rig, quantity)
        step = step_of(values)
        if step is not None and step > COARSER * own and step > spread:
            out[signal] = step
    return out


def step_of(values: Array) -> float | None:
    """The step of a grid on which nearly all values lie, None where there is none."""
    levels = np.unique(values)
    if len(levels) < 3 or len(levels) > 0.8 * len(values):
        return None
    gaps = np.diff(levels)
    gaps = gaps[gaps > 1e-9 * max(float(np.ptp(levels)), 1e-12)]
    if not len(gaps):
        return None
    step = float(np.quantile(gaps, 0.02))
    close = gaps[np.abs(gaps / step - np.round(gaps / step)) < 0.1]
    if len(close) < 0.9 * len(gaps):
        return None
    step = float(np.sum(close) / np.sum(np.round(close / step)))
    place = (values - levels[0]) / step
    on_grid = np.abs(place - np.round(place)) < OFF
    return step if float(on_grid.mean()) > ON_GRID else None
