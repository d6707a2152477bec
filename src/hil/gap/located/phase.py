"""Where refits begin: forces read half a tick earlier or later, where the record says so at once.

A drive's force swings within each tick of its position loop, as setpoints that are joined by lines kick it.
At which instant of the tick it is read, no rig file tells, and half a tick from the true one no slope leads
there: it looks like another mass. Where loops keep step with SYNC, none tells either how long after it they
have their tick: a force half a tick early then looks as if it were read half a tick late.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hil.gap.catalogue.nuisances import LIMIT, Nuisance
from hil.gap.floor.noise import NoiseModel
from hil.gap.located.residual import Refit, cost, expected, refit, total
from hil.gap.record.problem import FORCES, LATENCY, Problem

Array = NDArray[np.float64]

MUCH: Final = 0.7
"""Of what a force leaves as its answers are told, up to which what another instant leaves counts."""
NOISE: Final = 1.05
"""Mean size of what may be left then, whitened, 0.8 of noise alone: another mass is no half tick, which
explains it all or is not it."""
DELAY: Final = ".transport_delay.delay"
PLACES: Final = (0.0, -0.5, -0.375, -0.25, -0.125, 0.125, 0.25, 0.375, 0.5)
"""Ticks from the middle of one at which loops in step with SYNC are tried."""
EARLY_LATE: Final = (-0.3, 0.3)
"""Ticks by which forces are read otherwise than a refit left them, and it is made once more."""
BETTER: Final = 1.0
"""Nats by which it must then leave less [on healthy axes of two worlds of others it leaves 10 to 81 less]."""
CALMER: Final = 0.92
"""Of what forces leave, what may be left then: what a gap pulls at takes little off, another place in the
tick takes 10 to 50 of 100 [the same axes; 3 where forces stand six floors off]."""


def settled(problem: Problem, noise: NoiseModel, nuisances: Sequence[Nuisance]) -> Refit:
    """The refit that leaves least: from where nuisances are thought to be, and from there once more with all
    forces read earlier and later, for over a tick no slope leads from one place to the next."""
    best = refit(problem, noise, nuisances, begun(problem, noise, nuisances))
    index = [problem.table.index(n.name) for n in nuisances if n.delays_a_force]
    for ticks in EARLY_LATE if index else ():
        start = np.array(best.vector)
        start[index] += ticks * problem.rig.bus.position_loop
        other = refit(problem, noise, nuisances, start, best.jacobian)
        left, least = (total(problem, noise, nuisances, x) for x in (other, best))
        forces, most = (_size_of_forces(problem, noise, x) for x in (other, best))
        if left < least - BETTER and forces < CALMER * most:
            best = other
    return best


def _size_of_forces(problem: Problem, noise: NoiseModel, found: Refit) -> float:
    """Mean size of what a refit leaves of forces, whitened; 0 where none is judged."""
    white, mine = noise.whiten(problem, found.residual), np.zeros(problem.size, dtype=bool)
    for x in problem.series:
        mine[x.part] |= x.quantity in FORCES
    judged = white[mine & problem.kept]
    return float(np.mean(np.abs(judged))) if len(judged) else 0.0


def begun(problem: Problem, noise: NoiseModel, nuisances: Sequence[Nuisance]) -> Array:
    """Where the nuisances are thought to be (P,), ticks in step with SYNC where they leave least, each
    force's latency at whichever of three leaves least."""
    vector = _in_step(problem, noise, nuisances, expected(problem, nuisances))
    half_s = 0.5 * problem.rig.bus.position_loop
    late = [
        (n.name.removesuffix(LATENCY), problem.table.index(n.name))
        for n in nuisances
        if n.delays_a_force and half_s <= LIMIT * n.sd
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


def _in_step(
    problem: Problem, noise: NoiseModel, nuisances: Sequence[Nuisance], vector: Array
) -> Array:
    """`vector` (P,) with the delay of each drive on a bus with SYNC at which all that it answers leaves
    least, within half a tick of the rig file's."""
    bus, out = problem.rig.bus, np.array(vector)
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
