"""Candidates that answer nearly alike, brought to the ends of their fits: which of them is nearer decides.

A fit ends where a round gains little beside all that is left. Two that answer alike then stand tens of nats
apart for no other reason than where each came from. So the best and its rivals are fitted once more, from
where the best has left the nuisances, with the nuisances' sensitivities there, and until little indeed is
gained.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Final

from hil.gap.fits.evidence import distance
from hil.gap.fits.fit import fit
from hil.gap.fits.fitted import Calibrated, Fit
from hil.gap.fits.frames import EFFECT as LOST
from hil.gap.fits.starts import relative
from hil.gap.located.residual import nuisance_sensitivities

Report = Callable[[str], None]

NEAR: Final = 0.8
"""Of what the best takes off, what a rival must."""
APART: Final = 1.0
"""Floors by which their answers differ at most."""
MOST: Final = 5
"""Rivals of the best."""
SETTLED: Final = 0.001
"""Share of what is left, by which a last round may still gain."""


def ended(c: Calibrated, none: Fit, fits: Sequence[Fit], say: Report) -> list[Fit]:
    """`fits`, the best of them and its rivals where their costs are least; as they are where it has none."""
    able = [f for f in fits if all(leaf.effect != LOST for leaf in f.leaves)]
    if len(able) < 2:
        return list(fits)
    ranked = sorted(able, key=lambda f: f.total(c))
    best = ranked[0]
    least = none.total(c) - NEAR * (none.total(c) - best.total(c))
    rivals = [
        f for f in ranked[1:] if f.total(c) < least and distance(c, best, f) < APART
    ][:MOST]  # fmt: skip
    if not rivals:
        return list(fits)
    say("fitting those that answer alike to their ends")
    J = nuisance_sensitivities(c.problem, c.nuisances, best.vector, best.residual)
    sd = [n.sd for n in c.nuisances]
    here = replace(c, jacobian=c.noise.whiten(c.problem, J) * sd)
    better: dict[int, Fit] = {}
    for f in (best, *rivals):
        found = fit(here, f.leaves, relative(c, f), best.z, settled=SETTLED)
        if found is not None and found.total(c) < f.total(c):
            better[id(f)] = found
    return [better.get(id(f), f) for f in fits]
