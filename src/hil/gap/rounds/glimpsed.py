"""Whether another twin is worth a whole round: the few best fits of the first one, made again beside it.

A round looks at every candidate there is. But a twin of which a record is explains it better whatever else is
at work, with the candidates that are known already or with none.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from hil.gap.fits.evidence import ALIKE, distance, weigh
from hil.gap.fits.fit import fit
from hil.gap.fits.fitted import Calibrated, Fit
from hil.gap.fits.starts import relative
from hil.gap.judged.clear import asked
from hil.gap.rounds.calmer import in_vector

MOST: Final = 3
"""Fits of unlike answers that stand for all: beside wrong ones the true effect is not best."""


def unlike(c: Calibrated, fits: Sequence[Fit]) -> list[Fit]:
    """The MOST likely of `fits` whose answers are unlike, likeliest first; none of them without effects."""
    ranked, _ = weigh(c, fits)
    best: list[Fit] = []
    for w in sorted((w for w in ranked if in_vector(w.fit)), key=lambda w: -w.log_evidence):
        if len(best) < MOST and all(distance(c, w.fit, f) > ALIKE for f in best):
            best.append(w.fit)
    return best


def again(mine: Calibrated, fits: Sequence[Fit], other: Calibrated, none: Fit) -> list[Fit]:
    """`none`, the fit without effects of another twin, `other`, and the likeliest of `fits`, of the twin that
    `mine` is of, made anew beside it."""
    made = (fit(other, f.leaves, relative(mine, f), f.z) for f in unlike(mine, fits))
    return [none, *(f for f in made if f is not None)]


def may_be_nothing(other: Calibrated, seen: Sequence[Fit]) -> bool:
    """Whether the best fit beside another twin has no more evidence than chance may give."""
    ranked, _ = weigh(other, seen)
    zero = next(w.log_evidence for w in ranked if not w.fit.leaves)
    return max(w.log_evidence for w in ranked) - zero < asked(other).decisive
