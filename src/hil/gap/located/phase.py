"""Where a refit begins: forces read half a tick earlier or later, where the record says so at once.

A drive's force swings within each tick of its position loop, as setpoints that are joined by lines kick it.
At which instant of the tick it is read, no rig file tells, and half a tick from the true one no slope leads
there: it looks like another mass.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hil.gap.catalogue.nuisances import LIMIT, Nuisance
from hil.gap.floor.noise import NoiseModel
from hil.gap.located.residual import expected
from hil.gap.record.problem import LATENCY, Problem

Array = NDArray[np.float64]

MUCH: Final = 0.7
"""Of what a force leaves as its answers are told, up to which what another instant leaves counts."""
NOISE: Final = 1.05
"""Mean size of what may be left then, whitened, 0.8 of noise alone: another mass is no half tick, which
explains it all or is not it."""
FORCES: Final = ("force", "current")


def begun(problem: Problem, noise: NoiseModel, nuisances: Sequence[Nuisance]) -> Array:
    """Where the nuisances are thought to be (P,), each force's latency at whichever of three leaves least."""
    vector = expected(problem, nuisances)
    half_s = 0.5 * problem.rig.bus.position_loop
    late = [
        (n.name.removesuffix(LATENCY), problem.table.index(n.name))
        for n in nuisances
        if n.name.endswith(LATENCY)
        and n.name.removesuffix(LATENCY).endswith(FORCES)
        and half_s <= LIMIT * n.sd
    ]
    if not late:
        return vector
    rows = np.tile(vector, (3, 1))
    for row, shift_s in zip(rows, (0.0, -half_s, half_s), strict=True):
        row[[k for _, k in late]] += shift_s
    left = [noise.whiten(problem, problem.measured - a) for a in problem.answers(rows)]
    for signal, k in late:
        mine = np.concatenate([np.r_[x.part] for x in problem.series if x.signal == signal])
        judged = mine[problem.kept[mine]]
        if not len(judged):
            continue
        size = [float(np.mean(np.abs(white[judged]))) for white in left]
        best = int(np.argmin(size))
        if size[best] < min(MUCH * size[0], NOISE):
            vector[k] = rows[best, k]
    return vector
