"""Whether a hysteresis goes round a loop: what follows the place alone is a spring, which no catalogue has.

Dahl's state is played along the way that the twin moves, and what of it a smooth function of the place
would do as well is taken off. Neither its force nor the rest of the rig is asked.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from hil.gap.fits.fitted import Calibrated, Fit
from hil.gap.record.leaf import Leaf
from hil.sim.friction import hysteresis_advance

Array = NDArray[np.float64]

OF_PLACE: Final = 0.75
"""Share of its variance that a spring does as well, from which on a hysteresis is one [R]: a third where it
gives way over a tenth of the travel, 0.8 and more over all of it."""
DEGREE: Final = 3
"""Of the polynomial in the place."""


def is_spring(c: Calibrated, f: Fit, leaf: Leaf) -> bool:
    """Whether the hysteresis `leaf` of a fit goes round no loop in any stretch of the record."""
    name = f"{leaf.name}.displacement"
    if name not in f.names:
        return False
    over_m = float(f.values[f.names.index(name)])
    ways = [m[f"{leaf.location}.position"] for m in c.problem.motion(f.vector)]
    return all(of_place(way, over_m) > OF_PLACE for way in ways)


def of_place(way_m: Array, over_m: float) -> float:
    """Share 0..1, which a cubic of the position explains, of the variance of a hysteresis that gives way over
    `over_m`, m (rad), along positions (M,), m (rad); 1 where nothing moves."""
    state = np.zeros(len(way_m))
    for k in range(1, len(way_m)):
        state[k] = hysteresis_advance(state[k - 1], way_m[k] - way_m[k - 1], over_m)
    if np.ptp(way_m) == 0.0:
        return 1.0
    place = np.vander((way_m - way_m.mean()) / np.ptp(way_m), DEGREE + 1)
    left = state - place @ np.linalg.lstsq(place, state, rcond=None)[0]
    return float(1.0 - np.var(left) / np.var(state))
