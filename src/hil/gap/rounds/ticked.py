"""The drives' ticks once more, where what explains the gap shows them better than the rig file's twin.

Ticks are read from the kicks of force that twin and drive share. Where an effect is at work the twin's kicks
are not the drive's: ticks are not found, or half a tick off, and then noise looks louder than it is and
the true effect leaves what another might explain. So they are looked for beside the best fits as well, where
the twin's kicks are others there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hil.gap.fits.fitted import Calibrated, Fit
from hil.gap.located.residual import cost
from hil.gap.located.result import Located
from hil.gap.record.arrivals import find_clocks
from hil.gap.record.fineness import CLEARER, fineness
from hil.gap.record.places import LATE
from hil.gap.record.problem import Problem
from hil.gap.record.ticks import Clocks, Ticks
from hil.gap.rounds.glimpsed import unlike

Array = NDArray[np.float64]

LESS: Final = 10.0
"""Nats by which ticks beside a fit must explain more than those beside the twin without effects."""
ABOUT: Final = 16
"""Places in a tick that are looked at beside a fit before ticks are looked for, which costs far more."""


def clocks_beside(located: Located, c: Calibrated, fits: Sequence[Fit]) -> Clocks | None:
    """The drives' ticks as that of the best `fits` shows them which then leaves least; None: as they are."""
    e = located.evidence
    best = unlike(c, fits)
    asked = [
        f
        for f in best
        if _kicks_otherwise(e.problem, f.vector, c.vector)
        and may_lie_elsewhere(e.problem, f.vector)
    ]

    def left(f: Fit, clocks: Clocks) -> float:
        residual = e.problem.with_clocks(clocks).residual(f.vector)
        return cost(e.noise.whiten(e.problem, residual), f.z, e.problem.discount)

    least, found = np.inf, None
    for f in asked:
        clocks = find_clocks(e.problem.with_clocks({}), f.vector)
        if set(clocks) >= set(e.problem.clocks) and clocks != e.problem.clocks:
            size = left(f, clocks)
            least, found = min((least, found), (size, clocks), key=lambda pair: pair[0])
    if found is None:
        return None
    return found if least < min(left(f, e.problem.clocks) for f in best) - LESS else None


def _kicks_otherwise(problem: Problem, vector: Array, usual: Array) -> bool:
    """Whether forces show the ticks of `problem` otherwise beside the twin of `vector` than beside the
    `usual` one, or those of a drive are not known."""
    keys = [(k, a) for k in range(len(problem.pieces)) for a in problem.rig.actuator_names]
    if any(key not in problem.clocks for key in keys):
        return True
    here, there = problem.predict(np.array([vector, usual]))
    return any(
        abs(fineness(problem, *key, here) - fineness(problem, *key, there)) > CLEARER
        for key in keys
    )


def may_lie_elsewhere(problem: Problem, vector: Array) -> bool:
    """Whether the force of some drive is clearer beside the twin of `vector` (P,) where all ticks of
    `problem` lie elsewhere, however late answers are, or ticks are not known or are no drive's own."""
    known = {key: x for key, x in problem.clocks.items() if isinstance(x, Ticks)}
    keys = [(k, a) for k in range(len(problem.pieces)) for a in problem.rig.actuator_names]
    if problem.rig.bus.retimed or len(known) < len(keys):
        return True
    tick_s = problem.rig.bus.position_loop
    late_s = [share * tick_s for share in LATE]

    def clearest(places: int) -> Array:
        by_s = tick_s * places / ABOUT
        there = {key: replace(x, phase_s=x.phase_s + by_s) for key, x in known.items()}
        flats = problem.with_clocks(there).forces_late(vector, late_s)
        return np.array([min(fineness(problem, *key, f) for f in flats) for key in keys])

    here = clearest(0)
    return any(np.any(clearest(m) < here - CLEARER) for m in range(1, ABOUT))
