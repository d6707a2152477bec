"""Springs, gaps and limits whose answer no linear picture shows: looked for one by one, each replayed.

A load that swings on its transmission answers to what excited it seconds before; a spring that swings a
little faster answers out of step, which is worse than none. Flanks meet at other instants in a gap that is a
little wider, and beside gaps of other actuators at others again. A limit that is a hundredth too low is hit
where the rig was free. Only a replay of each tells.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hil.gap.catalogue.leaves import spring
from hil.gap.catalogue.nature import FLANKS, LIMITS
from hil.gap.fits.about import is_swinging
from hil.gap.fits.fitted import Calibrated, Fit, replay_cost, spread_of
from hil.gap.located.events import held_off
from hil.gap.record.leaf import Leaf

Array = NDArray[np.float64]

SWINGS_HZ: Final = tuple(3.0 * 1.2**k for k in range(15))
HARDER: Final = (0.1, 0.3, 0.8)
"""How much a spring may stiffen: the more it is wound up, the faster it swings."""
NEAREST: Final = 4
"""Springs of those that do not stiffen, of which stiffening ones are tried."""
CLOSER: Final = ((0.96, 0.0), (0.98, 0.0), (1.0, 0.0), (1.0, 0.15), (1.0, 0.4))
"""Times the starts of a limit, and knees; a fit looks about the best of them (`hil.gap.fits.about`)."""
STANDS: Final = 2.0
"""Floors on a signal of an actuator, or of the IMU, from which on it is asked whether it swings."""
KNOCKS: Final = 1.2
"""The same of gaps and limits: flanks meet, and limits are hit, for moments."""
MOST: Final = 2
"""Actuators that are asked for each: those whose signals stand most above their floors."""
SHAKEN: Final = 3
"""Actuators that are asked for springs where an IMU is shaken most: drives tell little of whose it is."""


def struck(c: Calibrated, f: Fit) -> frozenset[str]:
    """Actuators of which a fit leaves a signal off to one side for longer than noise or late frames do."""
    off = held_off(c.problem, f.residual, c.noise.sigma)
    return frozenset(x.actuator for x in c.problem.series if off.get(x.signal, 0.0) > 1.0)


def suspects(
    c: Calibrated,
    none: Fit,
    leaves: Sequence[Leaf],
    held: Collection[str] = (),
    promise: Mapping[str, float] | None = None,
) -> list[Leaf]:
    """The springs, gaps and limits among `leaves` where most is left without effects, worst first; before all
    others those of actuators that are `held` off. Where an IMU is shaken most, springs go by what they
    `promise` in the linear picture, by name."""
    over = _over(c, none.residual)
    worst: dict[str, float] = {}
    for x in c.problem.series:
        worst[x.actuator] = max(worst.get(x.actuator, 0.0), over[x.signal])
    ranked = sorted(leaves, key=lambda x: (x.location not in held, -worst.get(x.location, 0.0)))
    shaken = worst.get("imu", 0.0)  # by whichever actuator
    most = max((v for a, v in worst.items() if a != "imu"), default=0.0)
    told, asked = (promise or {}, SHAKEN) if shaken > most else ({}, MOST)
    springs = [
        x
        for x in sorted(ranked, key=lambda x: -told.get(x.name, 0.0))
        if is_swinging(x.parameters) and max(worst.get(x.location, 0.0), shaken) > STANDS
    ]
    hit = [
        x for x in ranked if x.location in held or max(worst.get(x.location, 0.0), shaken) > KNOCKS
    ]
    gaps = [x for x in hit if x.effect in FLANKS]
    limits = [x for x in hit if x.effect in LIMITS]
    return springs[:asked] + gaps[:MOST] + limits[:MOST]


def _over(c: Calibrated, residual: Array) -> dict[str, float]:
    """Floors that a residual has on each signal: spikes and all, or weighed by where noise is small."""
    out: dict[str, float] = {}
    for rms in (c.noise.rms, c.noise.weighted_rms):
        left, floors = rms(c.problem, residual), rms(c.problem, c.noise.draws)
        for signal, floor in floors.items():
            out[signal] = max(out.get(signal, 0.0), left[signal] / max(floor, 1e-300))
    return out


def least_left(c: Calibrated, none: Fit, leaf: Leaf) -> dict[str, float]:
    """Values of the parameters of `leaf` that leave least; empty where all are worse than none."""
    if leaf.effect in FLANKS:
        some = [tuple(s.columns[0].values()) for s in leaf.starts]
    elif leaf.effect in LIMITS:
        starts = [value for s in leaf.starts for value in s.columns[0].values()]
        some = [(value * near, knee) for value in starts for near, knee in CLOSER]
    else:
        a = next(x for x in c.problem.rig.actuators if x.name == leaf.location)
        some = [(*spring(a, f), 0.0) for f in SWINGS_HZ]
    left = left_by(c, none, leaf.parameters, some)
    if leaf.effect not in (*FLANKS, *LIMITS):
        near = [some[k] for k in np.argsort(left)[:NEAREST]]
        harder = [(k, d, h) for k, d, _ in near for h in HARDER]
        some, left = [*some, *harder], [*left, *left_by(c, none, leaf.parameters, harder)]
    best = int(np.argmin(left))
    unmoved = c.problem.measured - none.residual
    if left[best] >= replay_cost(c, unmoved, spread_of(c, none.white)):
        return {}
    return dict(zip(leaf.parameters, some[best], strict=True))


def left_by(
    c: Calibrated, f: Fit, names: Sequence[str], some: Sequence[tuple[float, ...]]
) -> list[float]:
    """What the twin of a fit leaves with each of `some` values of the parameters `names` in its place."""
    rows = np.tile(f.vector, (len(some), 1))
    rows[:, [c.problem.table.index(n) for n in names]] = some
    spread = spread_of(c, f.white)
    return [replay_cost(c, answer, spread) for answer in c.problem.answers(rows)]
