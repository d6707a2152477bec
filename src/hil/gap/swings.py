"""Springs whose resonance no linear picture shows: looked for one by one, at all swings and stiffenings.

A load that swings on its transmission answers to what excited it seconds before; a spring that swings a
little faster answers out of step, which is worse than none. Only a replay of each tells.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hil.gap.about import is_swinging
from hil.gap.fitted import Calibrated, Fit, replay_cost, spread_of
from hil.gap.leaves import Leaf, spring

Array = NDArray[np.float64]

SWINGS_HZ: Final = tuple(3.0 * 1.2**k for k in range(15))
HARDER: Final = (0.0, 0.1, 0.3, 0.8)
"""How much a spring may stiffen: the more it is wound up, the faster it swings."""
STANDS: Final = 2.0
"""Floors on a signal of an actuator from which on it is asked whether it swings."""
MOST: Final = 2
"""Actuators that are asked: those whose signals stand most above their floors."""


def unsteady(c: Calibrated, none: Fit, leaves: Sequence[Leaf]) -> list[Leaf]:
    """The springs among `leaves` at the actuators of which most is left without effects, worst first."""
    left = c.noise.weighted_rms(c.problem, none.residual)
    floors = c.noise.weighted_rms(c.problem, c.noise.draws)
    worst: dict[str, float] = {}
    for x in c.problem.series:
        if floors[x.signal] > 0.0:
            ratio = left[x.signal] / floors[x.signal]
            worst[x.actuator] = max(worst.get(x.actuator, 0.0), ratio)
    able = [x for x in leaves if is_swinging(x.parameters) and worst.get(x.location, 0.0) > STANDS]
    return sorted(able, key=lambda x: -worst[x.location])[:MOST]


def swing(c: Calibrated, none: Fit, leaf: Leaf) -> dict[str, float]:
    """Values of the parameters of `leaf`, a spring, that leave least; empty where all are worse than none."""
    table, problem = c.problem.table, c.problem
    a = next(x for x in problem.rig.actuators if x.name == leaf.location)
    index = [table.index(n) for n in leaf.parameters]
    some = [(*spring(a, f), h) for f in SWINGS_HZ for h in HARDER]
    rows = np.tile(none.vector, (len(some), 1))
    rows[:, index] = some
    spread = spread_of(c, none.white)
    costs = [replay_cost(c, answer, spread) for answer in problem.answers(rows)]
    best = int(np.argmin(costs))
    if costs[best] >= replay_cost(c, problem.measured - none.residual, spread):
        return {}
    return dict(zip(leaf.parameters, some[best], strict=True))
