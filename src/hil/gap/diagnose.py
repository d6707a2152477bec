"""Which effect makes the gap: candidates proposed, fitted through the twin, weighed, scored on held-out data.

The steps: locate the gap (after the nuisances, calibrated on healthy references where there are any); what
every candidate would do to every sample; the candidates, alone and together, that could explain it; fits of
the best of them; evidence, classes, the chance that it is nothing in the catalogue; shrink on data that no
fit has seen. docs/gap.md says why each is done so.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import replace
from typing import Final

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from hil.config import RigFile
from hil.gap.bank import ABSOLUTE, Bank, fill_bank
from hil.gap.diagnosis import Cause, Diagnosis, ParameterValue, Verdict
from hil.gap.evidence import Weighed, classes, weigh
from hil.gap.fit import Calibrated, Fit, calibrated, changes_of, fit
from hil.gap.frames import EFFECT as LOST
from hil.gap.frames import fit_lost_frames
from hil.gap.heldout import Score, score, split, touched, traces
from hil.gap.leaves import Leaf, Start, find_leaves
from hil.gap.locate import RATIO, locate
from hil.gap.nuisances import Nuisance, default_nuisances
from hil.gap.problem import Problem
from hil.gap.residual import Refit
from hil.gap.restrict import noise_of, part_of
from hil.gap.result import Located
from hil.gap.rounding import coarse_steps
from hil.gap.runs import as_runs
from hil.gap.search import Proposal, Search
from hil.runs import Run

Array = NDArray[np.float64]
Report = Callable[[str], None]

SINGLES: Final = 5
"""Candidates that are fitted alone."""
WORTH: Final = 0.25
"""Of the best linear gain, below which no candidate is fitted."""
PAIRS: Final = 3
LEFT: Final = 1.35
"""Floors on any signal from which on more than one effect is looked for."""
EXPLAINED: Final = 0.72
"""Share of the gap's energy that a verdict must explain, half of the time [set on training cases]."""
SOFT: Final = 0.06
FRICTION: Final = frozenset(
    {"coulomb_friction", "viscous_friction", "stribeck_friction", "asymmetric_friction", "load_friction",
     "hysteresis"}
)  # fmt: skip
SURE: Final = 0.8
"""Probability from which on one candidate is the verdict."""
LARGE: Final = 2.0
"""Floors on any signal over the whole record that are a gap, however short its parts."""
ROUNDED: Final = "sensor_quantisation"
STRAIN: Final = 2.6
"""Prior standard deviations from which on a nuisance is suspected to hide an effect."""
SUSPECT: Final = 1.2
"""Floors on any signal from which on candidates are weighed at all."""
CLEAR: Final = 15.0
"""Nats of evidence from which on a candidate is more than a chance among many [set on training cases]."""
MATERIAL: Final = 0.75
"""Floors that its trace must have on some signal."""
WELL: Final = 0.93
"""Share explained from which on nothing more is looked for."""
VISIBLE: Final = 0.3
"""Floors that a candidate of a usual size must show on some signal to be judged at all."""
CI: Final = 1.645
WIDEN: Final = 1.5
"""Of what noise does to a parameter [set on training cases]."""
OTHER_LAW: Final = 0.13
"""Of an effect's own size, by which the parameter of another law may differ [set on training cases]."""


def diagnose(
    runs: Run | pd.DataFrame | Iterable[Run | pd.DataFrame],
    rig: RigFile,
    *,
    references: Run | pd.DataFrame | Iterable[Run | pd.DataFrame] = (),
    without: Collection[str] = (),
    seed: int = 0,
    report: Report | None = None,
) -> Diagnosis:
    """Diagnose the gap between `runs` (Run objects or pandas frames) and the twin of `rig`.

    `references`: healthy runs of the same rig, on which the nuisances are calibrated first, so that the
    answer is what has changed since. `without`: effects that must not be considered. `report` is told
    each step. Equal `seed`, equal answer. IdentificationError where the data cannot carry an answer.
    """
    say = report or (lambda _: None)
    loaded = as_runs(runs, rig)
    healthy = as_runs(references, rig)
    nuisances = None
    if healthy:
        say("calibrating on the healthy references")
        found = locate(healthy, rig, seed=seed)
        nuisances = as_found(found, default_nuisances(rig, found.evidence.problem.signals))
    say("locating the gap")
    located = locate(loaded, rig, nuisances=nuisances, seed=seed)
    return explain(located, nuisances, without=without, seed=seed, report=say)


def as_found(found: Located, priors: Sequence[Nuisance]) -> list[Nuisance]:
    """Nuisances as references leave them: where they stand, and as wide as they may still drift.

    `found`: the references located with `priors`.
    """
    by_name = {n.name: n for n in priors}
    out = []
    for f in found.nuisances:
        n = by_name[f.name]
        out.append(replace(n, mean=f.change, sd=float(np.hypot(f.sd, DRIFT * n.sd))))
    return out


DRIFT: Final = 0.25
"""Of a nuisance's prior: how far a rig drifts between a reference and a run [R]."""


def explain(
    located: Located,
    nuisances: Sequence[Nuisance] | None = None,
    *,
    without: Collection[str] = (),
    seed: int = 0,
    report: Report | None = None,
) -> Diagnosis:
    """The diagnosis of what `locate` found, whose `nuisances` are given."""
    say = report or (lambda _: None)
    e = located.evidence
    whole = e.problem
    ends, held_out = split(whole, _run_numbers(whole))
    chosen = tuple(nuisances or default_nuisances(whole.rig, whole.signals))
    steps = {} if "sensor_quantisation" in without else coarse_steps(whole)
    if not (
        located.is_gap or steps or _strained(located, chosen) or _weighed_ratio(located) > SUSPECT
    ):
        return _no_gap(located, held_out)
    problem, rows = part_of(whole, ends)
    noise = noise_of(e.noise, whole, problem, rows)
    start = Refit(e.vector, e.residual[rows], e.jacobian[rows], ())
    c = calibrated(problem, noise, chosen, start)
    none = fit(c, (), {})
    if none is None:
        raise AssertionError("the calibrated twin stood a moment ago")
    c = replace(c, vector=none.vector, residual=none.residual, white=none.white, z=none.z)
    say("computing what each candidate would do")
    leaves = find_leaves(problem, none.vector, none.residual, without)
    bank = fill_bank(problem, none.vector, problem.measured - none.residual, leaves)
    search = Search(c, bank)
    fits = [none, *_single_fits(c, none, search, leaves, without, steps, say)]
    fits = [f for f in fits if not _is_narrow(f)]
    fits += [f for f in _joint_fits(c, fits, search, leaves, say) if not _is_narrow(f)]
    held = np.ones(whole.size, dtype=bool)
    held[rows] = False
    return _answer(located, c, fits, bank, held, held_out, seed)


def _run_numbers(problem: Problem) -> list[int]:
    names = [p.name.partition(" (")[0] for p in problem.pieces]
    order = {name: k for k, name in enumerate(dict.fromkeys(names))}
    return [order[n] for n in names]


def _weighed_ratio(located: Located) -> float:
    """Largest usual residual of a signal over its floor."""
    e = located.evidence
    left = e.noise.usual(e.problem, e.residual)
    floors = e.noise.usual(e.problem, e.noise.draws)
    return max(left[s] / floors[s] for s in left if floors[s] > 0.0)


def _strained(located: Located, nuisances: Sequence[Nuisance]) -> bool:
    """Whether a nuisance had to go further from its prior's mean than calibrations do."""
    mean = {n.name: n.mean for n in nuisances}
    return any(
        f.at_bound or abs(f.change - mean[f.name]) > STRAIN * f.prior_sd for f in located.nuisances
    )


def _no_gap(located: Located, held_out: str) -> Diagnosis:
    return Diagnosis(
        located, "no_gap", located.sentence, (), (), 0.0, None, None, held_out, (), None, None, None
    )


def _single_fits(
    c: Calibrated,
    none: Fit,
    search: Search,
    leaves: Sequence[Leaf],
    without: Collection[str],
    steps: dict[str, float],
    say: Report,
) -> list[Fit]:
    proposals = search.alone()
    top = proposals[0].gain
    out = []
    for k, p in enumerate(proposals[:SINGLES]):
        if p.gain < max(WORTH * top, 3.0):
            break
        leaf = leaves[p.leaves[0]]
        say(f"fitting {leaf.name} ({k + 1})")
        found = fit(c, [leaf], search.felt(changes_of([leaf], p.starts, c.problem)))
        if found is not None:
            out.append(found)
    well = max((explained(c, none, f) for f in out), default=0.0)
    if LOST not in without and well < WELL:
        say("looking for lost frames")
        lost = fit_lost_frames(c, none)
        if lost is not None:
            out.append(lost)
    out += [_rounded(c, none, signal, step) for signal, step in steps.items()]
    return out


def _is_narrow(f: Fit) -> bool:
    """Whether a hysteresis went as narrow as it may: then it is how friction begins, and no hysteresis."""
    return any(n.endswith(".hysteresis.displacement") for n in f.at_bound)


def _rounded(c: Calibrated, none: Fit, signal: str, step: float) -> Fit:
    """The twin whose `signal` comes in steps; values on a grid cannot be chance, so they earn by count."""
    name = f"{signal}.sensor_quantisation.step"
    leaf = Leaf(ROUNDED, signal, (name,), (Start({}, ({name: step},)),), None)
    vector = np.array(none.vector)
    vector[c.problem.table.index(name)] = step
    residual = c.problem.measured - c.problem.answers(vector)[0]
    count = sum(int(c.train[x.part].sum()) for x in c.problem.series if x.signal == signal)
    return replace(
        none, leaves=(leaf,), names=(name,), values=np.array([step]), search_sd=np.array([1e-3 * step]),
        vector=vector, residual=residual, white=c.noise.whiten(c.problem, residual),
        extra_cost=-5.0 * count,
    )  # fmt: skip


def _joint_fits(
    c: Calibrated, fits: Sequence[Fit], search: Search, leaves: Sequence[Leaf], say: Report
) -> list[Fit]:
    """Pairs and triples, where the best single or pair leaves something."""
    out: list[Fit] = []
    known = {leaf.name for leaf in leaves}
    ranked = sorted(fits[1:], key=lambda f: f.cost(c.train) + f.prior_cost + f.extra_cost)
    heads = [f for f in ranked if f.leaves[0].name in known][:2]
    for size in (2, 3):
        if (
            not heads
            or _largest_ratio(c, heads[0]) < LEFT
            or explained(c, fits[0], heads[0]) > WELL
        ):
            break
        new: list[Fit] = []
        for p in _proposed(c, heads, search, leaves)[: PAIRS + 2 - size]:
            some = [leaves[k] for k in p.leaves]
            say("fitting " + " + ".join(leaf.name for leaf in some))
            start = search.felt(changes_of(some, p.starts, c.problem))
            head = next((h for h in heads if all(x in some for x in h.leaves)), None)
            if head is not None:
                start.update(_relative(c, head))
            joint = fit(c, some, start)
            if joint is not None:
                new.append(joint)
        out += new
        heads = sorted(new, key=lambda f: f.cost(c.train) + f.prior_cost)[:1]
    return out


def _proposed(
    c: Calibrated, heads: Sequence[Fit], search: Search, leaves: Sequence[Leaf]
) -> list[Proposal]:
    """Each head with the leaves that could explain what it leaves, best first."""
    index = {leaf.name: k for k, leaf in enumerate(leaves)}
    out: dict[tuple[int, ...], Proposal] = {}
    for head in heads:
        fixed = tuple(index[leaf.name] for leaf in head.leaves)
        rest = Search(c, search.bank, head.white).alone()
        others = [p.leaves[0] for p in rest if _may_join(leaves[p.leaves[0]], head.leaves)]
        for k in others[: PAIRS + 1]:
            found = search.set_of((*fixed, k))
            if found is not None:
                out.setdefault(tuple(sorted(found.leaves)), found)
    return sorted(out.values(), key=lambda p: -p.gain)


def _may_join(leaf: Leaf, others: Sequence[Leaf]) -> bool:
    """Whether a leaf can act beside `others`: not itself again, no second law of friction at one place."""
    return not any(
        leaf.name == x.name
        or (leaf.location == x.location and leaf.effect in FRICTION and x.effect in FRICTION)
        for x in others
    )


def _relative(c: Calibrated, f: Fit) -> dict[str, float]:
    """Values of fitted parameters as starts give them: for a twin without effects."""
    out = {}
    for name, value in zip(f.names, f.values.tolist(), strict=True):
        p = c.problem.table[name]
        now = float(c.vector[c.problem.table.index(name)])
        is_added = p.search == "linear" and np.isfinite(p.neutral) and p.parameter not in ABSOLUTE
        out[name] = value - now + p.neutral if is_added else value
    return out


def _largest_ratio(c: Calibrated, f: Fit) -> float:
    """Largest usual residual of a signal on training samples, in its floor."""
    left = c.noise.usual(c.problem, f.residual)
    floors = c.noise.usual(c.problem, c.noise.draws)
    return max(left[s] / floors[s] for s in left if floors[s] > 0.0)


def explained(c: Calibrated, none: Fit, f: Fit) -> float:
    """Share of the gap's energy above the floor that a fit takes away on training samples, 0..1."""
    floors = c.noise.weighted_rms(c.problem, c.noise.draws)
    before = c.noise.weighted_rms(c.problem, none.residual)
    after = c.noise.weighted_rms(c.problem, f.residual)
    ratios = [(before[s] / v, after[s] / v) for s, v in floors.items() if v > 0.0]
    was = sum(max(b**2 - 1.0, 0.0) for b, _ in ratios)
    left = sum(max(a**2 - 1.0, 0.0) for b, a in ratios)
    return float(np.clip((was - left) / max(was, 0.05), 0.0, 1.0))


def _answer(
    located: Located,
    c: Calibrated,
    fits: Sequence[Fit],
    bank: Bank,
    held: NDArray[np.bool_],
    held_out: str,
    seed: int,
) -> Diagnosis:
    none = fits[0]
    weighed, worth = weigh(c, fits)
    zero = next(w.log_evidence for w in weighed if not w.fit.leaves)
    weighed = [w for w in weighed if w.fit.leaves]
    if not weighed:
        return replace(_no_gap(located, held_out), not_excited=not_excited(c, bank))
    first, gain = weighed[0].fit, weighed[0].log_evidence - zero
    is_large = _largest_ratio(c, none) > RATIO or max(s.ratio for s in located.signals) > LARGE
    is_clear = gain > CLEAR and max(traces(c, none, first).values()) > MATERIAL
    if not (is_large or is_clear):
        return replace(_no_gap(located, held_out), not_excited=not_excited(c, bank))
    share = 1.0 if first.leaves[0].effect == ROUNDED else explained(c, none, first)
    unknown = float(1.0 / (1.0 + np.exp((share - EXPLAINED) / SOFT)))
    if gain < CLEAR:
        unknown = max(unknown, 0.9)
    rng = np.random.default_rng(seed + 2)
    shown = _Shown(located, none, held, rng)
    causes = _causes(c, none, weighed, worth, unknown, zero, shown)
    chosen = tuple(
        next(x for x in causes if (x.effect, x.location) == (leaf.effect, leaf.location))
        for leaf in first.leaves
    )
    signals = touched(c, none, first) or c.problem.signals
    part, whole = shown.score(first, signals), shown.score(first, c.problem.signals)
    verdict, sentence = judge(chosen, causes, unknown, part.shrink)
    return Diagnosis(
        located, verdict, sentence, causes, chosen if verdict != "unknown" else (), unknown,
        part, whole, held_out, not_excited(c, bank), first, none, c,
    )  # fmt: skip


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
        if f.leaves and f.leaves[0].effect == LOST:
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
        jacobian = np.zeros((e.problem.size, 0))
        c = calibrated(e.problem, e.noise, (), Refit(f.vector, self.before, jacobian, ()))
        found = fit_lost_frames(
            c, replace(self.none, residual=self.before, white=c.white, vector=self.none.vector)
        )
        return self.before if found is None else found.residual


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
    heads = [source[n].fit if several or n not in singles else singles[n].fit for n in source]
    groups = dict(zip(source, classes(c, heads), strict=True))
    mean_worth = float(np.mean(list(worth.values())))
    out = []
    for name, w in source.items():
        leaf = next(x for x in w.fit.leaves if x.name == name)
        shrink = None
        if probability[name] > 0.02:
            shrink = shown.score(w.fit, touched(c, none, w.fit) or c.problem.signals).shrink
        out.append(
            Cause(
                leaf.effect, leaf.location, probability[name] * (1.0 - unknown), groups[name],
                _parameters(c, w.fit, leaf, mean_worth), shrink, w.log_evidence - zero, w.fit,
            )
        )  # fmt: skip
    return tuple(sorted(out, key=lambda x: -x.probability))


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
