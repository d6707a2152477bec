"""A sensor whose zero goes one way along a ride, as one does that warms up: no effect of the catalogue.

A bicycle goes to and fro, and what its model lacks does so too: over a whole ride little of it goes one way.
What does is a sensor's. It is slow and small beside the rider's motion, so that a gap's size does not tell
it; how far it goes beside what pieces of the ride differ by otherwise does.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hil.bicycle.sensors import IMU_SIGNALS
from hil.gap.located.result import Located

Array = NDArray[np.float64]

FAR: Final = 3.0
"""Floors that a zero must go [set on 48 rides, looked at on 174 of exams 630 and 631 and five other worlds:
of three whose sensors warm up the least has 3.5, one with two other effects 4.0 beside nuisances alone]."""
CLEAR: Final = 6.0
"""Times what it would go by chance [of the same rides those that warm up have 8.3 at least; that one has 6.8,
healthy ones 5.6 at most and then 1.1 floors]."""
PIECE_S: Final = 2.0
"""What lasts longer than that a rider does not do."""
FEWEST: Final = 8
"""Pieces from which on a ride tells."""


@dataclass(frozen=True, slots=True)
class Drift:
    """How far a signal goes one way along a ride, in its unit, and how many times what chance makes of it."""

    span: float
    clear: float


@dataclass(frozen=True, slots=True)
class Warm:
    """A signal whose zero goes one way, and that in words."""

    signal: str
    text: str


def warms_up(located: Located, left: Array) -> Warm | None:
    """The sensor whose zero goes furthest along a ride, of what is `left` (N,); None where none does."""
    e = located.evidence
    gaps = {s.signal: s for s in located.signals if s.signal in IMU_SIGNALS}
    most, found = FAR, None
    for x in e.problem.series:
        if x.signal not in gaps:
            continue
        kept, gap = e.problem.kept[x.part], gaps[x.signal]
        told = drift(e.problem.t_s[x.part][kept], left[x.part][kept])
        if told is not None and told.clear > CLEAR and told.span > most * gap.noise_floor:
            most = told.span / gap.noise_floor
            size = f"{told.span:.2g} {gap.unit}, {most:.1f} floors"
            found = Warm(x.signal, f"the zero of {x.signal} goes one way along a ride, by {size}")
    return found


def drift(t: Array, left: Array) -> Drift | None:
    """Of what is `left` (N,) of a signal at instants `t` (N,) s; None of too few pieces."""
    count = int(np.ptp(t) / PIECE_S) if len(t) else 0
    if count < FEWEST:
        return None
    edges = np.linspace(t[0], t[-1], count + 1)
    pieces = np.split(left, np.searchsorted(t, edges[1:-1]))
    along = np.array([k for k, p in enumerate(pieces) if len(p)]) / count
    means = np.array([np.mean(p) for p in pieces if len(p)])
    if len(means) < FEWEST:
        return None
    goes = np.polyval(np.polyfit(along, means, 2), along)
    by_chance = float(np.std(means - goes)) * np.sqrt(2.0 / (len(means) - 3))
    return Drift(float(np.ptp(goes)), float(np.std(goes)) / max(by_chance, 1e-300))
