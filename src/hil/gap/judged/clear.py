"""Which weighed fits are findings: each effect of them neither chance nor trifle beside the others."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from typing import Final

from hil.gap.catalogue.nature import ALWAYS
from hil.gap.fits.evidence import MORE, SAME, Weighed, distance
from hil.gap.fits.facts import EFFECT as ROUNDED
from hil.gap.fits.facts import is_fact
from hil.gap.fits.fitted import Calibrated, Fit
from hil.gap.fits.frames import EFFECT as LOST
from hil.gap.fits.further import is_further
from hil.gap.fits.heldout import Score, touched, traces
from hil.gap.fits.shares import explained
from hil.gap.record.leaf import Leaf
from hil.gap.search.standing import goes_further

EXPLAINED: Final = 0.46
"""Share of the gap's energy that a verdict must explain, half of the time: what is none of the catalogue is
explained by less than a third, a catalogue's effect of another law by more than half [set on training cases
of two worlds]."""
BORNE_OUT: Final = (5.0, 0.5, 1.5, 0.8)
"""Nats, floors of its trace, floors of the gap on unseen data and the share of it that goes, from which on an
effect is a finding however little fits have seen of it [healthy records of two worlds: never above 1.3 floors
with more than a tenth of it gone]."""
MOST: Final = (0.6, 0.85)
"""Of what stands without them, what effects that ALWAYS act must explain where they are small, and where they
are nearly certain only."""


@dataclass(frozen=True, slots=True)
class Asked:
    """What a candidate must have to be a finding."""

    nats: float
    """Of evidence: more than a chance among many."""
    trace: float
    """Floors of its trace on some signal."""
    always: float
    """The same of effects that ALWAYS act: none of them hides in rare events, and whatever a twin lacks looks
    a little like one of them."""
    decisive: float
    faint: float
    """Nats, and floors of its trace, of a candidate that is small and beyond doubt all the same."""
    certain: float
    nearly: float
    always_faint: float
    """The same of effects that ALWAYS act, which must explain MOST besides."""
    saved: float
    """Nats of the nuisances' priors that an effect saves and no healthy rig spends: it was hidden in
    nuisances, which went to their bounds."""
    further: float
    """Nats of an effect that is a nuisance too and stands further than that may (`is_further`); one that
    ALWAYS acts must be decisive: delays of a busy bus are further off than most."""


COUNTED: Final = Asked(
    nats=10.0, trace=0.3, always=1.0, decisive=20.0, faint=0.15, certain=90.0, nearly=32.0,
    always_faint=0.6, saved=15.0, further=5.0,
)  # fmt: skip
"""Of rigs, many samples of which count as one [set on cases of the used-up exams of seeds 81 and 111, of
tuning seeds and of a second world: a healthy rig has up to 13 nats with 0.2 floors; of what ALWAYS acts up to
72 with 0.83, and spends up to 12 on priors that an effect saves, nine of ten less than 6; what is nearly
certain is set on 40 healthy records of three worlds, which have up to 25 where all is explained]."""
IN_FULL: Final = Asked(
    nats=11.0, trace=0.75, always=1.2, decisive=40.0, faint=0.4, certain=120.0, nearly=120.0,
    always_faint=0.8, saved=10.0, further=math.inf,
)  # fmt: skip
"""Of rides, of which each sample counts [set on training cases; of what does not ALWAYS act 38 healthy rides
of two worlds of others have up to 18 nats, and spend up to 8 on priors that an effect saves]."""


def asked(c: Calibrated) -> Asked:
    """What a finding must have, as samples are counted."""
    return COUNTED if c.problem.discount > 1.0 else IN_FULL


def other_than_facts(f: Fit) -> tuple[Leaf, ...]:
    """Effects of a fit that are a question: no steps of a signal, no answers that are missing."""
    return tuple(leaf for leaf in f.leaves if not is_fact(leaf))


def clear(
    c: Calibrated,
    none: Fit,
    weighed: Sequence[Weighed],
    zero: float,
    is_large: bool,
    unseen: Callable[[Fit], Score],
) -> list[Weighed]:
    """Those of which each effect is neither chance nor trifle beside the others; alone, any of a large gap
    and any that `unseen` data bear out.

    What answers as the best of them does is one as well: no threshold tells those apart.
    A set must be clear beside each part of it and beside the best of each smaller size, and explain much of
    what that leaves. Where the best is a trifle itself, the others must be clear beside it. Beside steps of a
    signal, what else there may be must explain what a verdict must.
    """
    by_names = {_names(w.fit): w for w in reversed(weighed)}
    likely = sorted(weighed, key=lambda w: -w.log_evidence)

    def adds(w: Weighed, base: frozenset[str]) -> bool:
        f, log = (by_names[base].fit, by_names[base].log_evidence) if base else (none, zero)
        leaves = [x for x in other_than_facts(w.fit) if x.name not in base]
        gain, trace = w.log_evidence - log, _trace(c, f, w.fit)
        saved = f.prior_cost - w.fit.prior_cost
        share = partial(explained, c, f, w.fit)
        if base and saved > asked(c).saved:  # what strains nuisances so is there, known or not
            gain += MORE * len(leaves)
        if gain > _asked_further(asked(c), leaves) and is_further(c, f, w.fit, leaves):
            return True
        return not leaves or _isclear(asked(c), gain, trace, saved, leaves, share)

    @cache
    def is_borne_out(name: frozenset[str]) -> bool:
        w = by_names[name]
        nats, trace, floors, share = BORNE_OUT
        if w.log_evidence - zero < nats or _trace(c, none, w.fit) < trace:
            return False
        part = unseen(w.fit)
        return part.before > floors * part.floor and (part.shrink or 0.0) > share

    def isclear(w: Weighed) -> bool:
        others, names = other_than_facts(w.fit), _names(w.fit)
        if others and len(others) < len(names) and explained(c, none, w.fit) < EXPLAINED:
            return False
        if len(names) == 1:
            return is_large or adds(w, frozenset()) or is_borne_out(names)
        if not all(adds(w, base) for base in by_names if base < names):
            return False
        best = (
            next((x for x in likely if len(x.fit.leaves) == k), None) for k in range(1, len(names))
        )
        simpler = [x for x in best if x is not None and not _names(x.fit) < names]
        return all(adds(w, _names(x.fit)) and goes_further(c, x.fit, w.fit) for x in simpler)

    def beside(w: Weighed, best: Weighed) -> bool:
        both = by_names.get(_names(w.fit) | _names(best.fit))
        return both is not None and adds(both, _names(best.fit))

    out = [w for w in weighed if isclear(w)]
    if out and not isclear(weighed[0]) and len(weighed[0].fit.leaves) == 1:
        out = [
            w for w in out
            if beside(w, weighed[0]) or (len(w.fit.leaves) == 1 and is_borne_out(_names(w.fit)))
        ]  # fmt: skip
    if out:
        best = out[0].fit
        out += [
            w for w in weighed
            if all(w is not x for x in out) and len(w.fit.leaves) == len(best.leaves)
            and distance(c, w.fit, best) < SAME
        ]  # fmt: skip
        out.sort(key=lambda w: -w.probability)
    total = max(sum(w.probability for w in out), 1e-300)
    return [replace(w, probability=w.probability / total) for w in out]


def _names(f: Fit) -> frozenset[str]:
    return frozenset(leaf.name for leaf in f.leaves)


def _trace(c: Calibrated, none: Fit, f: Fit) -> float:
    """Floors by which a fit moves the signal that it moves most."""
    return max(traces(c, none, f).values())


def signals(c: Calibrated, none: Fit, f: Fit) -> tuple[str, ...]:
    """Signals that a fit touches: its steps', and those that it changes visibly."""
    steps = {leaf.location for leaf in f.leaves if leaf.effect == ROUNDED}
    moved = steps.union(touched(c, none, f))
    return tuple(s for s in c.problem.signals if s in moved) or c.problem.signals


def _asked_further(a: Asked, leaves: Sequence[Leaf]) -> float:
    """Nats that are asked of nuisances that stand further than they may."""
    acts_always = any(leaf.effect in ALWAYS for leaf in leaves)
    return max(a.further, a.decisive) if acts_always else a.further


def _isclear(
    a: Asked,
    gain: float,
    trace: float,
    saved: float,
    leaves: Sequence[Leaf],
    share: Callable[[], float],
) -> bool:
    """Whether effects of `gain` nats that move a signal by `trace` floors, save so many nats of priors and
    explain `share` of what stands without them, are neither chance nor trifle. Frames that were lost have
    each earned their odds."""
    if all(leaf.effect == LOST for leaf in leaves):
        return gain > a.nats
    acts_always = all(leaf.effect in ALWAYS for leaf in leaves)
    if saved > a.saved and (trace > a.always_faint or not acts_always):
        return gain > a.nats
    if acts_always:
        least = MOST[0] if gain > a.certain else MOST[1]
        if gain > a.nearly and trace > a.always_faint and share() > least:
            return True
        return gain > a.nats and trace > a.always
    return (gain > a.nats and trace > a.trace) or (gain > a.decisive and trace > a.faint)
