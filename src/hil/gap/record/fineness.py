"""The fine structure of force: what a record and a twin whose setpoints act elsewhere do not share."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hil.gap.record.problem import FORCES, Problem

Array = NDArray[np.float64]

CLEARER: Final = 0.06
"""Log of the fine structure that other instants must take off to be believed."""

GAUSSIAN: Final = -0.43
"""Mean of log(|n| + a tenth of its median), n normal of spread 1."""


def fineness(problem: Problem, stretch: int, actuator: str, flat: Array) -> float:
    """Log of the fine structure of an actuator's force in a stretch."""
    total = 0.0
    for _, steps, kept in fine_structure(problem, stretch, actuator, [flat]):
        s = steps[0, kept]
        total += float(np.mean(np.log(s + 0.1 * np.median(s) + 1e-12)))
    return total


def quiet(problem: Problem, stretch: int, actuator: str) -> float:
    """What `fineness` is where nothing but the sensors' noise of the rig file is left."""
    noise, total = problem.rig.noise, 0.0
    for x in problem.series:
        if x.stretch == stretch and x.actuator == actuator and x.quantity in FORCES:
            step = getattr(noise, f"{x.quantity}_step") / np.sqrt(12.0)
            spread = np.hypot(getattr(noise, x.quantity), step)
            total += float(np.log(np.sqrt(2.0) * spread + 1e-12)) + GAUSSIAN
    return total


def fine_structure(
    problem: Problem, stretch: int, actuator: str, flats: Sequence[Array]
) -> Iterator[tuple[Array, Array, NDArray[np.bool_]]]:
    """Of each signal of force: instants (M,), its fine structure (F, M - 1) beside each prediction, and
    which of that is judged (M - 1,)."""
    for x in problem.series:
        if x.stretch == stretch and x.actuator == actuator and x.quantity in FORCES:
            t, own = problem.t_s[x.part], [f[x.part] for f in flats]
            steps = np.array([_steps(t, problem.measured[x.part] - f, f) for f in own])
            kept = problem.kept[x.part][1:]
            if kept.any():
                yield t, steps, kept


def _steps(t: Array, residual: Array, predicted: Array) -> Array:
    """Sizes of the residual's first differences, whatever its constant delay: what a shift in time would
    take away is taken away."""
    slope = np.diff(np.gradient(predicted, t))
    step = np.diff(residual)
    return np.abs(step - slope * (slope @ step) / max(float(slope @ slope), 1e-300))
