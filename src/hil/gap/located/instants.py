"""At which instants forces are read, beside a twin that has settled.

A drive's force swings within each tick of its loops, so that what a latency leaves has several dips, and a
fit that starts in the wrong one ends there: a payload then looks as if it were not enough, or nuisances pull
at their bounds. One replay tells what every latency would leave, and a fit goes on from the best.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hil.gap.catalogue.nuisances import Nuisance
from hil.gap.floor.noise import NoiseModel
from hil.gap.located.residual import reach
from hil.gap.record.problem import LATENCY, Problem

Array = NDArray[np.float64]

SHIFTS: Final = np.arange(-4.5, 4.6, 0.5)
"""Of a latency's prior, by which it is tried elsewhere."""
NEAR: Final = 1e-9
"""Of a prior, within which a nuisance stands at its bound."""


def read_elsewhere(
    problem: Problem,
    noise: NoiseModel,
    nuisances: Sequence[Nuisance],
    vector: Array,
    z: Array,
    size: Callable[[Array, NDArray[np.bool_]], float],
) -> tuple[Array, Array]:
    """`vector` (P,) and the `nuisances` (K,), which stand at `z` (K,) in spreads of their priors, with each
    force's latency where it leaves least.

    `size`: nats of whitened residuals (N,) where a mask (N,) says so.
    """
    new_vector, new_z = np.array(vector), np.array(z)
    late = [(row, n) for row, n in enumerate(nuisances) if n.delays_a_force]
    if not late:
        return new_vector, new_z
    sd = late[0][1].sd
    flats = problem.forces_late(vector, (sd * SHIFTS).tolist())
    left = [noise.whiten(problem, problem.measured - flat) for flat in flats]
    least, most = reach(problem, nuisances)
    for row, nuisance in late:
        signal = nuisance.name.removesuffix(LATENCY)
        mine = np.zeros(problem.size, dtype=bool)
        for x in problem.series:
            mine[x.part] = x.signal == signal
        at = z[row] + SHIFTS * sd / nuisance.sd
        cost = np.array([size(white, mine) for white in left]) + 0.5 * at**2
        cost[(at < least[row] - NEAR) | (at > most[row] + NEAR)] = np.inf
        best = int(np.argmin(cost))
        new_vector[problem.table.index(nuisance.name)] += nuisance.sd * (at[best] - z[row])
        new_z[row] = at[best]
    return new_vector, new_z
