"""What a twin leaves of forces once they are read as late as they seem: noise is told from that.

A force that is answered later than calibration may set right has its kicks elsewhere than the twin's: two are
left then for each. Those are fast, as noise is, and would be taken for it, and the effect that moves them
would have nothing to explain.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from hil.gap.record.fineness import fineness
from hil.gap.record.problem import FORCES, Problem

Array = NDArray[np.float64]

LATE_S: Final = (0.0, *(0.0005 * k for k in range(1, 13)), 0.007, 0.008, 0.01, 0.012, 0.015, 0.02)
"""By which forces may be read later than calibration has them."""
MUCH: Final = 0.5
"""Log of the fine structure that this must take off [set on 42 records of three worlds: one whose force is
3.5 ms late has 0.66 and 1.07, the healthy ones 0.3 at most, where no ticks are found]."""


def without_lateness(problem: Problem, vector: Array, residual: Array) -> Array:
    """The `residual` (N,) that the twin of `vector` (P,) leaves, of each actuator's forces answered as late
    as leaves much less of a fine structure and less in all, if any does."""
    if not any(x.quantity in FORCES for x in problem.series):
        return residual
    out, answers = residual.copy(), problem.forces_late(vector, LATE_S)
    stretches = range(len(problem.pieces))
    for actuator in problem.rig.actuator_names:
        sizes = [np.mean([fineness(problem, k, actuator, y) for k in stretches]) for y in answers]
        best = int(np.argmin(sizes))
        own = np.zeros(problem.size, dtype=bool)
        for x in problem.series:
            own[x.part] |= x.quantity in FORCES and x.actuator == actuator
        left, kept = problem.measured - answers[best], own & problem.kept
        # what is calmer and stands further off is no force that is late
        is_less = np.sum(left[kept] ** 2) < np.sum(residual[kept] ** 2)
        if is_less and sizes[best] < sizes[0] - MUCH:
            out[own] = left[own]
    return out
