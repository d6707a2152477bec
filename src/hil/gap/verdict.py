"""What weighed fits amount to: causes with probabilities and intervals, held-out shrink, the verdict."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hil.gap.bank import Bank
from hil.gap.diagnosis import Cause, Diagnosis, ParameterValue, Verdict
from hil.gap.evidence import ALIKE, Weighed, distance, weigh
from hil.gap.fit import Calibrated, Fit, calibrated
from hil.gap.frames import ANSWERS, SETPOINTS, fit_lost_frames
from hil.gap.frames import EFFECT as LOST
from hil.gap.heldout import Score, score, touched, traces
from hil.gap.leaves import Leaf
from hil.gap.locate import RATIO
from hil.gap.residual import Refit
from hil.gap.result import Located
from hil.gap.rounding import EFFECT as ROUNDED
from hil.gap.shares import explained, largest_ratio

Array = NDArray[np.float64]

EXPLAINED: Final = 0.46
"""Share of the gap's energy that a verdict must explain, half of the time: what is none of the catalogue is
explained by less than a third, a catalogue's effect of another law by more than half [set on training cases
of two worlds]."""
SOFT: Final = 0.06
"""How gradually."""
OTHERWISE: Final = 0.03
"""Chance that even what is all explained is none of the catalogue."""
SURE: Final = 0.8
"""Probability from which on one candidate is the verdict."""
LARGE: Final = 2.0
"""Floors on any signal that its usual residual, wild samples aside, must stand above to be a gap alone."""
CLEAR: Final = 15.0
"""Nats of evidence from which on a candidate is more than a chance among many [set on training cases]."""
CHANCE: Final = 5.0
"""Nats below which the best of many candidates may be one by chance."""
MATERIAL: Final = 0.75
"""Floors that its trace must have on some signal."""
ALWAYS: Final = frozenset(
    {"loop_gain", "transport_delay", "sensor_latency", "sensor_scale", "clock_drift", "force_constant",
     "actuator_inertia", "payload_mass", "payload_inertia", "viscous_friction", "compliance"}
)  # fmt: skip
STEADY: Final = 1.2
"""Floors of the trace of effects that ALWAYS act: whatever a twin lacks everywhere looks a little like one of
them, and none of them hides in rare events [set on training cases of two worlds]."""
HOLDS: Final = 0.05
"""Held-out shrink below which a verdict is withdrawn, where the gap stands STANDS floors high there."""
STANDS: Final = 1.3
DECISIVE: Final = 120.0
FAINT: Final = 0.4
"""Nats, and floors of its trace, of a candidate that is small and beyond doubt all the same."""
VISIBLE: Final = 0.3
"""Floors that a candidate of a usual size must show on some signal to be judged at all."""
CI: Final = 1.645
WIDEN: Final = 1.5
"""Of what noise does to a parameter [set on training cases]."""
OTHER_LAW: Final = 0.13
"""Of an effect's own size, by which the parameter of another law may differ [set on training cases]."""


def no_gap(located: Located, held_out: str) -> Diagnosis:
    """Nothing to explain."""
    return Diagnosis(
        located, "no_gap", located.sentence, (), (), 0.0, None, None, held_out, (), None, None, None
    )


def _nothing_like_it(located: Located, held_out: str) -> Diagnosis:
    """A gap of which no candidate has the pattern."""
    worst = max(located.signals, key=lambda s: s.ratio)
    sentence = (
        f"A gap that nothing in the catalogue explains: {worst.signal} stands {worst.ratio:.1f} times above "
        "its floor, and no candidate has its pattern."
    )
    return replace(no_gap(located, held_out), verdict="unknown", sentence=sentence, unknown=1.0)


def answer(
    located: Located,
    c: Calibrated,
    fits: Sequence[Fit],
    bank: Bank,
    held: NDArray[np.bool_],
    held_out: str,
    seed: int,
) -> Diagnosis:
    """The diagnosis of `fits`, the first of them the twin without effects; `held` (N,): unseen samples."""
    none = fits[0]
    weighed, worth = weigh(c, fits)
    zero = next(w.log_evidence for w in weighed if not w.fit.leaves)
    is_large = largest_ratio(c, none) > LARGE or max(s.ratio for s in located.signals) > RATIO
    weighed = _clear(c, none, [w for w in weighed if w.fit.leaves], zero, is_large)
    if not weighed:
        found = _nothing_like_it(located, held_out) if is_large else no_gap(located, held_out)
        return replace(found, not_excited=not_excited(c, bank))
    first, gain = weighed[0].fit, weighed[0].log_evidence - zero
    share = explained(c, none, first) if _other_than_steps(first) else 1.0
    unknown = OTHERWISE + (1.0 - OTHERWISE) / float(1.0 + np.exp((share - EXPLAINED) / SOFT))
    if gain < CHANCE:
        unknown = max(unknown, 0.9)
    if unknown > 0.5 and not is_large:
        return replace(no_gap(located, held_out), not_excited=not_excited(c, bank))
    rng = np.random.default_rng(seed + 2)
    shown = _Shown(located, none, held, rng)
    signals = _signals(c, none, first)
    part, whole = shown.score(first, signals), shown.score(first, c.problem.signals)
    if part.shrink is not None and part.shrink < HOLDS and part.before > STANDS * part.floor:
        unknown = max(unknown, 0.9)  # unseen data do not bear it out
    causes = _causes(c, none, weighed, worth, unknown, zero, shown)
    chosen = tuple(
        next(x for x in causes if (x.effect, x.location) == (leaf.effect, leaf.location))
        for leaf in first.leaves
    )
    verdict, sentence = judge(chosen, causes, unknown, part.shrink)
    return Diagnosis(
        located, verdict, sentence, causes, chosen if verdict != "unknown" else (), unknown,
        part, whole, held_out, not_excited(c, bank), first, none, c,
    )  # fmt: skip


def _other_than_steps(f: Fit) -> tuple[Leaf, ...]:
    """Effects of a fit that are no steps of a signal: those are read from its values and no question."""
    return tuple(leaf for leaf in f.leaves if leaf.effect != ROUNDED)


def _clear(
    c: Calibrated, none: Fit, weighed: Sequence[Weighed], zero: float, is_large: bool
) -> list[Weighed]:
    """Those of which each effect is neither chance nor trifle beside the others; alone any, of a large gap.

    Where the best is a trifle itself, the others must be clear beside it. Beside steps of a signal, what else
    there may be must explain what a verdict must.
    """
    by_names = {_names(w.fit): w for w in weighed}

    def adds(w: Weighed, base: frozenset[str]) -> bool:
        f, log = (by_names[base].fit, by_names[base].log_evidence) if base else (none, zero)
        leaves = [x for x in _other_than_steps(w.fit) if x.name not in base]
        return not leaves or _is_clear(w.log_evidence - log, _trace(c, f, w.fit), leaves)

    def is_clear(w: Weighed) -> bool:
        others, names = _other_than_steps(w.fit), _names(w.fit)
        if others and len(others) < len(names) and explained(c, none, w.fit) < EXPLAINED:
            return False
        if len(names) == 1:
            return is_large or adds(w, frozenset())
        return all(adds(w, base) for base in by_names if base < names)

    def beside(w: Weighed, best: Weighed) -> bool:
        both = by_names.get(_names(w.fit) | _names(best.fit))
        return both is not None and adds(both, _names(best.fit))

    out = [w for w in weighed if is_clear(w)]
    if out and not is_clear(weighed[0]) and len(weighed[0].fit.leaves) == 1:
        out = [w for w in out if beside(w, weighed[0])]
    total = max(sum(w.probability for w in out), 1e-300)
    return [replace(w, probability=w.probability / total) for w in out]


def _names(f: Fit) -> frozenset[str]:
    return frozenset(leaf.name for leaf in f.leaves)


def _trace(c: Calibrated, none: Fit, f: Fit) -> float:
    """Floors by which a fit moves the signal that it moves most."""
    return max(traces(c, none, f).values())


def _signals(c: Calibrated, none: Fit, f: Fit) -> tuple[str, ...]:
    """Signals that a fit touches: its steps', and those that it changes visibly."""
    steps = {leaf.location for leaf in f.leaves if leaf.effect == ROUNDED}
    moved = steps.union(touched(c, none, f))
    return tuple(s for s in c.problem.signals if s in moved) or c.problem.signals


def _is_clear(gain: float, trace: float, leaves: Sequence[Leaf]) -> bool:
    """Whether effects of `gain` nats that move a signal by `trace` floors are neither chance nor trifle."""
    if all(leaf.effect in ALWAYS for leaf in leaves):
        return gain > CLEAR and trace > STEADY
    return (gain > CLEAR and trace > MATERIAL) or (gain > DECISIVE and trace > FAINT)


class _Shown:
    """Fits on the whole record, held-out samples and all."""

    def __init__(
        self, located: Located, none: Fit, held: NDArray[np.bool_], rng: np.random.Generator
    ) -> None:
        self.e = located.evidence
        self.held, self.rng = held, rng
        self.none = none
        self.before = self.e.problem.residual(none.vector)

    def score(self, f: Fit, signals: Sequence[str]) -> Score:
        """Of a fit on held-out samples."""
        if any(leaf.effect == LOST for leaf in f.leaves):
            after = self._without_lost(f)
            return score(
                self.e.problem, self.e.noise, self.before, after, self.held, signals, self.rng
            )
        answer = self.e.problem.answers(f.vector)[0]
        after = np.where(np.isfinite(answer), self.e.problem.measured - answer, self.before)
        return score(self.e.problem, self.e.noise, self.before, after, self.held, signals, self.rng)

    def _without_lost(self, f: Fit) -> Array:
        """Residual (N,) without the frames that were lost: which ones, the held-out record itself tells."""
        e = self.e
        vector = np.array(f.vector)
        for name in (SETPOINTS, ANSWERS):
            k = e.problem.table.index(name)
            vector[k] = self.none.vector[k]
        residual = e.problem.residual(vector)
        none = Refit(vector, residual, np.zeros((e.problem.size, 0)), ())
        c = calibrated(e.problem, e.noise, (), none)
        base = replace(self.none, residual=residual, white=c.white, vector=vector)
        found = fit_lost_frames(c, base)
        return residual if found is None else found.residual


def _causes(
    c: Calibrated,
    none: Fit,
    weighed: Sequence[Weighed],
    worth: dict[str, float],
    unknown: float,
    zero: float,
    shown: _Shown,
) -> tuple[Cause, ...]:
    """Every leaf that was fitted, with its probability over all sets that hold it, best first."""
    singles = {w.fit.leaves[0].name: w for w in weighed if len(w.fit.leaves) == 1}
    several = len(weighed[0].fit.leaves) > 1
    probability: dict[str, float] = {}
    source: dict[str, Weighed] = {}
    for w in weighed:
        for leaf in w.fit.leaves:
            probability[leaf.name] = probability.get(leaf.name, 0.0) + w.probability
            source.setdefault(leaf.name, w)
    heads = {n: source[n].fit if several or n not in singles else singles[n].fit for n in source}
    groups = _classes(c, heads)
    mean_worth = float(np.mean(list(worth.values())))
    out = []
    for name, w in source.items():
        leaf = next(x for x in w.fit.leaves if x.name == name)
        shrink = None
        if probability[name] > 0.02:
            shrink = shown.score(w.fit, _signals(c, none, w.fit)).shrink
        out.append(
            Cause(
                leaf.effect, leaf.location, probability[name] * (1.0 - unknown), groups[name],
                _parameters(c, w.fit, leaf, mean_worth), shrink, w.log_evidence - zero, w.fit,
            )
        )  # fmt: skip
    return tuple(sorted(out, key=lambda x: -x.probability))


def _classes(c: Calibrated, heads: Mapping[str, Fit]) -> dict[str, int]:
    """For each candidate by name, with the fit that stands for it, the number of its class.

    Candidates of one set are told apart by being together in it.
    """
    first: list[str] = []
    out = {}
    for name, f in heads.items():
        mine = {leaf.name for leaf in f.leaves}
        near = next(
            (k for k, n in enumerate(first)
             if n not in mine and all(name != leaf.name for leaf in heads[n].leaves)
             and distance(c, f, heads[n]) < ALIKE),
            None,
        )  # fmt: skip
        if near is None:
            first.append(name)
            near = len(first) - 1
        out[name] = near
    return out


def _parameters(c: Calibrated, f: Fit, leaf: Leaf, worth: float) -> dict[str, ParameterValue]:
    out = {}
    for name, value, sd in zip(f.names, f.values, f.search_sd, strict=True):
        if name not in leaf.parameters:
            continue
        p = c.problem.table[name]
        x = p.to_search(float(value))
        away = x - p.to_search(p.neutral) if np.isfinite(p.to_search(p.neutral)) else x
        half = np.hypot(CI * WIDEN * float(sd) * np.sqrt(worth), OTHER_LAW * away)
        ends = sorted(float(p.from_search(e)) for e in (x - half, x + half))
        out[p.parameter] = ParameterValue(
            float(value), (max(ends[0], p.lower), min(ends[1], p.upper)), p.unit, name in f.at_bound
        )
    return out


def judge(
    chosen: Sequence[Cause], causes: Sequence[Cause], unknown: float, shrink: float | None
) -> tuple[Verdict, str]:
    """Verdict and sentence for the best set `chosen` among all `causes`."""
    names = " and ".join(f"{x.effect.replace('_', ' ')} at {x.location}" for x in chosen)
    if unknown > 0.5:
        return "unknown", (
            f"A gap that nothing in the catalogue explains; the nearest is {names}, which leaves too much."
        )
    far = (
        "" if shrink is None else f" It takes {100.0 * shrink:.0f} % of the gap off held-out data."
    )
    if min(x.probability for x in chosen) / (1.0 - unknown) >= SURE:
        return "identified", f"The gap comes from {names}.{far}"
    others = [x for x in causes if x not in chosen and x.probability > 0.05]
    rest = ", ".join(f"{x.effect.replace('_', ' ')} at {x.location}" for x in others[:3])
    return "ambiguous", (
        f"The gap comes most likely from {names}; these data cannot rule out {rest}.{far}"
    )


def not_excited(c: Calibrated, bank: Bank) -> tuple[str, ...]:
    """Candidates that at a usual size would change no signal visibly on these data."""
    floors = c.noise.weighted_rms(c.problem, c.noise.draws)
    weight = 1.0 / c.noise.sigma**2 * c.problem.kept
    size = np.zeros(bank.columns.shape[1])
    for signal in c.problem.signals:
        parts = [x.part for x in c.problem.series if x.signal == signal]
        total = sum(weight[p] @ bank.columns[p].astype(float) ** 2 for p in parts)
        share = np.sqrt(total / max(sum(float(weight[p].sum()) for p in parts), 1e-300))
        size = np.maximum(size, share / max(floors[signal], 1e-300))
    return tuple(
        leaf.name
        for leaf, starts in zip(bank.leaves, bank.places, strict=True)
        if max((size[k] for start in starts for k in start), default=0.0) < VISIBLE
    )
