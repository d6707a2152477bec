"""Signals in steps coarser than the rig file says: seen in the values themselves, no twin needed.

What is seen so is a fact, no candidate: the other candidates are judged beside it, by a floor that has the
steps in.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hil.gap.floor.blurred import blurred_step
from hil.gap.floor.draws import sensor_noise
from hil.gap.floor.noise import NoiseModel
from hil.gap.record.problem import Problem

Array = NDArray[np.float64]

COARSER: Final = 1.8
"""Times the rig file's own step, or the noise, from which on steps are an effect."""
BLURRED: Final = 2.5
"""Times the noise, from which on steps can be seen through it."""
ON_GRID: Final = 0.99
OFF: Final = 0.03
"""Of a step, that a value may lie beside the grid."""
FINER: Final = 0.3
"""Of a step, up to which another grid is a finer one."""
TOO_FINE: Final = 2.0
"""Times a finer grid's step, up to which two ways differ by that alone."""
SURE: Final = 4.0
"""Spreads of its noise that a value may be off what the twin says."""
MOVES: Final = 20.0
"""Steps or spreads of its noise by which a position is told to move, if it must."""
NOISY: Final = 2.0
"""Steps of a signal, above which its noise cannot but show."""
RETURNS: Final = 6
"""Changes between two levels from which on they are steps: a sensor that dies changes once."""


def coarse_steps(problem: Problem, residual: Array) -> dict[str, float]:
    """By signal, the step that its values keep to, where that is coarser than rig file and noise allow.

    `residual`: (N,), what the twin leaves of all samples; it tells of steps that noise has blurred.
    """
    out = {}
    for signal in problem.signals:
        mine = np.concatenate([np.r_[x.part] for x in problem.series if x.signal == signal])
        values = problem.measured[mine]
        quantity = signal.partition(".")[2].partition("_")[0]
        spread, own = sensor_noise(problem.rig, quantity)
        if is_still(values):
            if not must_move(quantity, values - residual[mine], spread, own):
                continue
            step = step_around(float(values[0]), residual[mine], spread)
        else:
            step = step_of(values, own)
        if step is None or not is_coarse(step, spread, own):
            kept = mine[problem.kept[mine]]
            finest = max(COARSER * own, BLURRED * spread)
            step = blurred_step(problem.measured[kept], residual[kept], spread, finest)
        if step is not None and is_coarse(step, spread, own):
            out[signal] = step
    return out


def is_still(values: Array) -> bool:
    """Whether a signal stays on one value."""
    return len(values) > 0 and float(np.ptp(values)) == 0.0


def must_move(quantity: str, told: Array, spread: float, own: float) -> bool:
    """Whether a healthy signal does not stay on one value: its noise is more than steps of its `own` hide, or
    it is a position, which has no noise at rest, and is `told` (N,) to move."""
    if quantity == "position":
        return len(told) > 0 and float(np.ptp(told)) > MOVES * max(own, spread, 1e-9)
    return spread > NOISY * own


def step_around(value: float, off: Array, spread: float) -> float | None:
    """The finest step of a grid through zero by which a signal that is `off` (N,) what the twin says and has
    noise of this `spread` always answers `value`; None where there is none, and the signal is stuck."""
    reach = float(np.max(np.abs(off))) + SURE * spread
    count = int(abs(value) / (2.0 * reach))
    return abs(value) / count if count else None


def is_coarse(step: float, spread: float, own: float) -> bool:
    """Whether a step is neither the rig file's `own` nor lost in noise of this `spread`."""
    return step > COARSER * own and step > spread


def step_of(values: Array, own: float = 0.0) -> float | None:
    """The step of a grid on which nearly all values lie, None where there is none. `own`: step of a finer
    grid that each of them may have been brought to besides."""
    levels = np.unique(values)
    if len(levels) == 2:
        return _of_two(values, levels)
    if len(levels) < 3:
        return None
    gaps = np.diff(levels)
    gaps = gaps[gaps > 1e-9 * max(float(np.ptp(levels)), 1e-12)]
    if not len(gaps):
        return None
    found = _on_grid(values, levels, gaps, float(np.quantile(gaps, 0.02)), own)
    if found is not None:
        return found
    # what moves on by several steps from each value to the next: by how much its ways differ
    ways = np.sort(gaps)
    others = np.flatnonzero(np.diff(ways) > max(TOO_FINE * own, 1e-6 * ways[-1])) + 1
    first = np.concatenate([[0], others])
    apart = np.diff(np.add.reduceat(ways, first) / np.diff(first, append=len(ways)))
    return _on_grid(values, levels, gaps, float(apart.min()), own) if len(apart) else None


def _on_grid(values: Array, levels: Array, gaps: Array, step: float, own: float) -> float | None:
    """About `step`, if nearly all `values` lie on a grid of such steps; `gaps`: between their `levels`."""
    aside = own / step if own < FINER * step else 0.0
    close = gaps[np.abs(gaps / step - np.round(gaps / step)) < 0.1 + aside]
    if len(close) < 0.9 * len(gaps):
        return None
    step = float(np.sum(close) / np.sum(np.round(close / step)))
    place = (values - levels[0]) / step
    on_grid = np.abs(place - np.round(place)) < OFF + aside
    return step if float(on_grid.mean()) > ON_GRID else None


def _of_two(values: Array, levels: Array) -> float | None:
    """The step between two levels of a grid through zero, between which a signal goes to and fro."""
    step = float(levels[1] - levels[0])
    on_grid = abs(levels[0] / step - round(levels[0] / step)) < OFF
    returns = int(np.count_nonzero(np.diff(values)))
    return step if on_grid and returns >= RETURNS else None


def coarser(
    noise: NoiseModel, problem: Problem, steps: Mapping[str, float], rng: np.random.Generator
) -> NoiseModel:
    """`noise` with the rounding that `coarse_steps` found."""
    drawn, sigma = np.array(noise.draws), np.array(noise.sigma)
    terms, gains = list(noise.ar), list(noise.gain)
    for k, x in enumerate(problem.series):
        step = steps.get(x.signal)
        if step is None:
            continue
        drawn[:, x.part] += step * (rng.random(drawn[:, x.part].shape) - 0.5)
        sigma[x.part] = np.hypot(sigma[x.part], step / np.sqrt(12.0))
        terms[k], gains[k] = np.empty(0), 1.0
    return replace(noise, draws=drawn, sigma=sigma, ar=tuple(terms), gain=tuple(gains))
