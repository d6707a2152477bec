"""At which instants forces are read, beside a fit that has settled.

A drive's force swings within each tick of its loops, so that what a latency leaves has several dips, and a
fit that starts in the wrong one ends there: a payload then looks as if it were not enough. One replay tells
what every latency would leave, and a fit goes on from the best.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hil.gap.fits.fitted import Calibrated, loss
from hil.gap.located.residual import reach
from hil.gap.record.problem import LATENCY

Array = NDArray[np.float64]

SHIFTS: Final = np.arange(-4.5, 4.6, 0.5)
"""Of a latency's prior, by which it is tried elsewhere."""


def read_elsewhere(
    c: Calibrated, held: Sequence[int], vector: Array, z: Array, spread: float
) -> tuple[Array, Array]:
    """`vector` (P,) and the nuisances `held` (K,), which stand at `z` (K,), with each force's latency where
    it leaves least, by the robust loss as wide as `spread`."""
    new_vector, new_z = np.array(vector), np.array(z)
    late = [(row, c.nuisances[k]) for row, k in enumerate(held) if c.nuisances[k].delays_a_force]
    if not late:
        return new_vector, new_z
    sd = late[0][1].sd
    flats = c.problem.forces_late(vector, (sd * SHIFTS).tolist())
    left = [c.noise.whiten(c.problem, c.problem.measured - flat) for flat in flats]
    least, most = reach(c.problem, c.nuisances)
    for row, nuisance in late:
        signal = nuisance.name.removesuffix(LATENCY)
        mine = np.zeros(c.problem.size, dtype=bool)
        for x in c.problem.series:
            mine[x.part] = x.signal == signal
        at = z[row] + SHIFTS * sd / nuisance.sd
        size = [spread**2 * float(np.sum(loss(w[mine & c.train] / spread))) for w in left]
        cost = np.array(size) + 0.5 * c.problem.discount * at**2
        cost[(at < least[held[row]]) | (at > most[held[row]])] = np.inf
        best = int(np.argmin(cost))
        new_vector[c.problem.table.index(nuisance.name)] += nuisance.sd * (at[best] - z[row])
        new_z[row] = at[best]
    return new_vector, new_z
