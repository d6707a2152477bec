"""The refit in which each force is read at the instant of a drive's tick that leaves least.

A drive's force swings within each tick of its position loop, as setpoints that are joined by lines kick it.
At which instant of the tick it is read, no rig file tells, and from the wrong one no slope leads to the true
one: it looks like another mass. Where loops keep step with SYNC, none tells either how long after it they
have their tick: a force half a tick early then looks as if it were read half a tick late.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hil.gap.catalogue.nuisances import Nuisance
from hil.gap.floor.noise import NoiseModel
from hil.gap.located.instants import read_elsewhere
from hil.gap.located.residual import Refit, cost, deviations, expected, refit, total
from hil.gap.record.problem import FORCES, Problem

Array = NDArray[np.float64]

DELAY: Final = ".transport_delay.delay"
PLACES: Final = (0.0, -0.5, -0.375, -0.25, -0.125, 0.125, 0.25, 0.375, 0.5)
"""Ticks from the middle of one at which loops in step with SYNC are tried."""
BETTER: Final = 1.0
"""Nats by which a refit from other instants must leave less [on healthy axes of two worlds of others it
leaves 10 to 80 less]."""
CALMER: Final = 0.92
"""Of what forces leave, what may be left then: what a gap pulls at takes little off, another place in the
tick takes 10 to 50 of 100 [the same axes; 3 where forces stand six floors off]."""


def settled(
    problem: Problem,
    noise: NoiseModel,
    nuisances: Sequence[Nuisance],
    jacobian: Array | None = None,
) -> Refit:
    """The refit that leaves least: from where nuisances are thought to be, and once more with each force read
    when it leaves least, for over a tick no slope leads from one place to the next. `jacobian`: as in
    `refit`."""
    best = refit(problem, noise, nuisances, begun(problem, noise, nuisances), jacobian)
    vector, _ = read_elsewhere(
        problem, noise, nuisances, best.vector, deviations(best, nuisances), partial(_nats, problem)
    )
    if np.array_equal(vector, best.vector):
        return best
    other = refit(problem, noise, nuisances, vector, best.jacobian)
    left, least = (total(problem, noise, nuisances, x) for x in (other, best))
    forces, most = (_size_of_forces(problem, noise, x) for x in (other, best))
    return other if left < least - BETTER and forces < CALMER * most else best


def _nats(problem: Problem, white: Array, mine: NDArray[np.bool_]) -> float:
    """Of whitened residuals (N,) where the mask (N,) says so and they are judged."""
    return cost(white[mine & problem.kept], np.zeros(0), problem.discount)


def _size_of_forces(problem: Problem, noise: NoiseModel, found: Refit) -> float:
    """Mean size of what a refit leaves of forces, whitened; 0 where none is judged."""
    white, mine = noise.whiten(problem, found.residual), np.zeros(problem.size, dtype=bool)
    for x in problem.series:
        mine[x.part] |= x.quantity in FORCES
    judged = white[mine & problem.kept]
    return float(np.mean(np.abs(judged))) if len(judged) else 0.0


def begun(problem: Problem, noise: NoiseModel, nuisances: Sequence[Nuisance]) -> Array:
    """Where the nuisances are thought to be (P,), but the delay of each drive on a bus with SYNC where all
    that it answers leaves least, within half a tick of the rig file's."""
    bus, vector = problem.rig.bus, expected(problem, nuisances)
    out = np.array(vector)
    delays = {n.name: n.sd for n in nuisances if n.name.endswith(DELAY)}
    if bus.schedule != "fast" or bus.retimed or problem.are_forces or not delays:
        return out
    index = [problem.table.index(name) for name in delays]
    rows = np.tile(vector, (len(PLACES), 1))
    rows[:, index] += bus.position_loop * np.array(PLACES)[:, None]
    left = [noise.whiten(problem, problem.measured - a) for a in problem.answers(rows)]
    for name, k in zip(delays, index, strict=True):
        own = np.zeros(problem.size, dtype=bool)
        for x in problem.series:
            own[x.part] |= x.actuator == name.removesuffix(DELAY)
        judged = own & problem.kept
        z = bus.position_loop * np.array(PLACES)[:, None] / delays[name]
        sizes = [cost(w[judged], z_of, problem.discount) for w, z_of in zip(left, z, strict=True)]
        out[k] = rows[int(np.argmin(sizes)), k]
    return out
