"""Which weighed fits are findings: each effect of them neither chance nor trifle beside the others."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Final

from hil.gap.evidence import Weighed
from hil.gap.fit import Calibrated, Fit
from hil.gap.frames import EFFECT as LOST
from hil.gap.heldout import touched, traces
from hil.gap.leaves import Leaf
from hil.gap.nature import ALWAYS
from hil.gap.rounding import EFFECT as ROUNDED
from hil.gap.shares import explained

EXPLAINED: Final = 0.46
"""Share of the gap's energy that a verdict must explain, half of the time: what is none of the catalogue is
explained by less than a third, a catalogue's effect of another law by more than half [set on training cases
of two worlds]."""
CLEAR: Final = 10.0
"""Nats of evidence from which on a candidate is more than a chance among many [set on training cases]."""
MATERIAL: Final = 0.5
"""Floors that its trace must have on some signal."""
STEADY: Final = 1.0
"""Floors of the trace of effects that ALWAYS act: none of them hides in rare events [set on training cases of
two worlds]."""
DECISIVE: Final = 30.0
FAINT: Final = 0.4
"""Nats, and floors of its trace, of a candidate that is small and beyond doubt all the same."""
STEADY_FAINT: Final = 0.8
MOST: Final = 0.6
CERTAIN: Final = 60.0
"""The same of effects that ALWAYS act, which must explain MOST of what stands without them besides [set on
training cases of two worlds, of which a healthy rig has 38 nats and 0.85 floors of a mass]."""
RELIEF: Final = 10.0
"""Nats of the nuisances' priors that an effect saves and no healthy rig spends: it was hidden in nuisances,
which went to their bounds [set on training cases of two worlds: healthy rigs spend up to 11 in all, nine of
ten less than 6]."""


def other_than_steps(f: Fit) -> tuple[Leaf, ...]:
    """Effects of a fit that are no steps of a signal: those are read from its values and no question."""
    return tuple(leaf for leaf in f.leaves if leaf.effect != ROUNDED)


def clear(
    c: Calibrated, none: Fit, weighed: Sequence[Weighed], zero: float, is_large: bool
) -> list[Weighed]:
    """Those of which each effect is neither chance nor trifle beside the others; alone any, of a large gap.

    Where the best is a trifle itself, the others must be clear beside it. Beside steps of a signal, what else
    there may be must explain what a verdict must.
    """
    by_names = {_names(w.fit): w for w in weighed}

    def adds(w: Weighed, base: frozenset[str]) -> bool:
        f, log = (by_names[base].fit, by_names[base].log_evidence) if base else (none, zero)
        leaves = [x for x in other_than_steps(w.fit) if x.name not in base]
        gain, trace = w.log_evidence - log, _trace(c, f, w.fit)
        saved = f.prior_cost - w.fit.prior_cost
        return not leaves or _isclear(gain, trace, saved, leaves, lambda: explained(c, f, w.fit))

    def isclear(w: Weighed) -> bool:
        others, names = other_than_steps(w.fit), _names(w.fit)
        if others and len(others) < len(names) and explained(c, none, w.fit) < EXPLAINED:
            return False
        if len(names) == 1:
            return is_large or adds(w, frozenset())
        return all(adds(w, base) for base in by_names if base < names)

    def beside(w: Weighed, best: Weighed) -> bool:
        both = by_names.get(_names(w.fit) | _names(best.fit))
        return both is not None and adds(both, _names(best.fit))

    out = [w for w in weighed if isclear(w)]
    if out and not isclear(weighed[0]) and len(weighed[0].fit.leaves) == 1:
        out = [w for w in out if beside(w, weighed[0])]
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


def _isclear(
    gain: float, trace: float, saved: float, leaves: Sequence[Leaf], share: Callable[[], float]
) -> bool:
    """Whether effects of `gain` nats that move a signal by `trace` floors, save so many nats of priors and
    explain `share` of what stands without them, are neither chance nor trifle. Frames that were lost have
    each earned their odds."""
    if saved > RELIEF or all(leaf.effect == LOST for leaf in leaves):
        return gain > CLEAR
    if all(leaf.effect in ALWAYS for leaf in leaves):
        if gain > CERTAIN and trace > STEADY_FAINT and share() > MOST:
            return True
        return gain > CLEAR and trace > STEADY
    return (gain > CLEAR and trace > MATERIAL) or (gain > DECISIVE and trace > FAINT)
