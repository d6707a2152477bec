"""Whether an effect that was found grows along the rides, as none of the catalogue does.

A clock that parts from the others, warmth or a strap that gives look like a delay, an offset or a turned
sensor of half their last size, most of the way. What is found then is too large at the start and too small at
the end: the answer's change with the effect, times time, takes off what is left.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hil.gap.bicycle.beside import beside
from hil.gap.bicycle.problem import RideProblem
from hil.gap.fits.fit import sensitivities
from hil.gap.fits.fitted import Calibrated, Fit, spread_of
from hil.gap.record.leaf import Leaf

Array = NDArray[np.float64]

SHARE: Final = 0.4
"""Of its own size, by which an effect must grow to be none of the catalogue [set on rides of five worlds: of
ten that were there none grows by more than 0.07, four clocks that part, where they may not be named, by 0.8
to 1]."""
NATS: Final = 6.0


def grow(c: Calibrated, best: Fit, leaves: Sequence[Leaf]) -> bool:
    """Whether effects `leaves` of `best` are much less at the start of the rides than at their end, or
    more."""
    share, nats = growth(c, best, leaves)
    return abs(share) > SHARE and nats > NATS


def growth(c: Calibrated, best: Fit, leaves: Sequence[Leaf]) -> tuple[float, float]:
    """By how much of their own size effects `leaves` of `best` differ together at the start and the end of a
    ride from what was found, and the nats that this explains; in the linear picture at the fit, nuisances and
    the effects' own sizes free."""
    problem = c.problem
    assert isinstance(problem, RideProblem)
    slopes = sensitivities(c, best.vector, problem.measured - best.residual, best.names)
    whole = np.zeros(problem.size)
    asked = {name for leaf in leaves for name in leaf.parameters}
    for k, name in enumerate(best.names):
        if name in asked:
            p, i = problem.table[name], problem.table.index(name)
            size = p.to_search(float(best.vector[i])) - p.to_search(float(problem.base[i]))
            whole += size * slopes[:, k]
    ramp = np.concatenate(
        [np.linspace(-1.0, 1.0, x.part.stop - x.part.start) for x in problem.series]
    )
    rest, spread = best.white[c.train], spread_of(c, best.white)
    free, held = np.column_stack([ramp * whole, slopes])[c.train], c.jacobian[c.train]
    without, _ = beside(rest, free[:, 1:], held, best.z, spread)
    with_growth, step = beside(rest, free, held, best.z, spread)
    return float(step[0]), without - with_growth
