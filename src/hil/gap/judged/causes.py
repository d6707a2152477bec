"""Candidates as causes: probabilities over all sets that hold them, classes, intervals, held-out shrink."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hil.gap.catalogue.nuisances import CRYSTALS, LOOPS, RATE
from hil.gap.fits.evidence import ALIKE, Weighed, distance
from hil.gap.fits.facts import is_fact, left_by
from hil.gap.fits.fitted import Calibrated, Fit, calibrated
from hil.gap.fits.frames import ANSWERS, SETPOINTS, fit_lost_frames
from hil.gap.fits.frames import EFFECT as LOST
from hil.gap.fits.heldout import Score, score
from hil.gap.fits.starts import chosen
from hil.gap.judged.clear import signals
from hil.gap.judged.diagnosis import Cause, ParameterValue
from hil.gap.located.residual import Refit
from hil.gap.located.result import Located
from hil.gap.record.leaf import Leaf

Array = NDArray[np.float64]

CI: Final = 1.645
WIDEN: Final = 1.5
"""Of what noise does to a parameter [set on training cases]."""
OTHER_LAW: Final = 0.13
"""Of an effect's own size, by which the parameter of another law may differ; of a wave, rad [set on training
cases]."""


class Shown:
    """Fits on the whole record, held-out samples and all."""

    def __init__(
        self, located: Located, none: Fit, held: NDArray[np.bool_], rng: np.random.Generator
    ) -> None:
        self.e = located.evidence
        self.held, self.rng = held, rng
        self.none = none
        self.before = self.e.problem.residual(none.vector)
        self._arrived: dict[bytes, Array] = {}

    def score(self, f: Fit, signals: Sequence[str]) -> Score:
        """Of a fit on held-out samples."""
        if any(leaf.effect == LOST and not is_fact(leaf) for leaf in f.leaves):
            after = self._without_lost(f)
            return score(
                self.e.problem, self.e.noise, self.before, after, self.held, signals, self.rng
            )
        after = left_by(self.e.problem, f, ~self.held)
        after = np.where(np.isfinite(after), after, self.before)
        return score(self.e.problem, self.e.noise, self.before, after, self.held, signals, self.rng)

    def _without_lost(self, f: Fit) -> Array:
        """Residual (N,) without the frames that were lost: which ones, the held-out record itself tells."""
        known = f.vector.tobytes()
        if known not in self._arrived:
            self._arrived[known] = self._beside_lost(f)
        return self._arrived[known]

    def _beside_lost(self, f: Fit) -> Array:
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


def weighed_causes(
    c: Calibrated,
    none: Fit,
    weighed: Sequence[Weighed],
    worth: float,
    unknown: float,
    zero: float,
    shown: Shown,
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
    out = []
    for name, w in source.items():
        leaf = next(x for x in w.fit.leaves if x.name == name)
        shrink = None
        if probability[name] > 0.02:
            shrink = shown.score(w.fit, signals(c, none, w.fit)).shrink
        out.append(
            Cause(
                leaf.effect, leaf.location, probability[name] * (1.0 - unknown), groups[name],
                _parameters(c, w.fit, leaf, worth), shrink, w.log_evidence - zero, w.fit,
            )
        )  # fmt: skip
    return tuple(sorted(out, key=lambda x: -x.probability))


def without_doubtful(
    c: Calibrated, weighed: Sequence[Weighed], worth: float, is_large: bool
) -> list[Weighed]:
    """The sets of `weighed` of which no effect may as well be what a healthy rig has of the same: one whose
    only parameter's interval reaches its neutral value. All, where no other is left; none, where the best
    has no other effect and the gap is not one by itself (`is_large`)."""

    def is_doubtful(f: Fit, leaf: Leaf) -> bool:
        values = _parameters(c, f, leaf, worth)
        if len(values) != 1 or leaf.effect == LOST:
            return False
        ((name, value),) = values.items()
        return value.ci[0] <= c.problem.table[f"{leaf.name}.{name}"].neutral <= value.ci[1]

    if (
        weighed
        and not is_large
        and all(is_doubtful(weighed[0].fit, x) for x in weighed[0].fit.leaves)
    ):
        return []
    left = [
        w for w in weighed
        if len(w.fit.leaves) == 1 or not any(is_doubtful(w.fit, x) for x in w.fit.leaves)
    ] or weighed  # fmt: skip
    total = max(sum(w.probability for w in left), 1e-300)
    return [replace(w, probability=w.probability / total) for w in left]


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
    """Values with intervals: of noise, of another law, and of what a healthy rig has of the same."""
    healthy = {n.name: math.hypot(CI * n.sd, n.mean) for n in c.nuisances}
    healthy |= {n: CRYSTALS for n in f.names if n.endswith(RATE)}
    healthy |= {n: LOOPS[n.rpartition(".")[2]] for n in f.names if ".loop_gain." in n}
    out = {}
    for name, value, sd in zip(f.names, f.values.tolist(), f.search_sd.tolist(), strict=True):
        if name not in leaf.parameters and not name.startswith(f"{leaf.name}."):
            continue
        p = c.problem.table[name]
        is_phase = p.parameter == "phase"
        shown = value % math.tau if is_phase else value
        x = p.to_search(shown)
        away = x - p.to_search(p.neutral) if math.isfinite(p.to_search(p.neutral)) else x
        other = OTHER_LAW * (1.0 if is_phase else away)
        had = abs(p.to_search(shown + healthy[name]) - x) if name in healthy else 0.0
        half = math.hypot(CI * WIDEN * sd * math.sqrt(worth), other, had)
        ends = sorted(p.from_search(e) for e in (x - half, x + half))
        out[p.parameter] = ParameterValue(
            shown, (max(ends[0], p.lower), min(ends[1], p.upper)), p.unit, name in f.at_bound
        )
    for name, value in chosen(c.problem, f).items():
        if name in leaf.parameters:
            p = c.problem.table[name]
            out[p.parameter] = ParameterValue(value, (value, value), p.unit, at_bound=False)
    return out
