"""Which effect makes the gap of a ride: the steps of `hil.gap.diagnose`, on the bicycle's candidates."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from hil.config import BicycleFile
from hil.gap.bicycle.intervals import widened
from hil.gap.bicycle.leaves import ride_nuisances
from hil.gap.bicycle.locate import locate_rides
from hil.gap.bicycle.noise import tempered, with_tolerances
from hil.gap.bicycle.problem import RideProblem
from hil.gap.bicycle.rounding import coarse_steps_of_rides, with_steps
from hil.gap.bicycle.sets import fit_sets
from hil.gap.catalogue.nuisances import Nuisance
from hil.gap.diagnose import as_found
from hil.gap.fits.evidence import MORE
from hil.gap.fits.fitted import Calibrated, Fit
from hil.gap.fits.heldout import Score, score, split, touched
from hil.gap.fits.rounded import EFFECT as ROUNDED
from hil.gap.fits.rounded import rounded
from hil.gap.fits.training import begin, candidates_of
from hil.gap.floor.noise import NoiseModel
from hil.gap.judged.clear import other_than_steps
from hil.gap.judged.diagnosis import Cause, Diagnosis
from hil.gap.judged.doubt import BORNE_OUT, STANDS, chance, least_explained
from hil.gap.judged.verdict import answer, judge, no_gap, stands
from hil.gap.located.result import Located
from hil.gap.record.problem import Mask
from hil.gap.search.linear import Search
from hil.runs import Run

EXPLAINED: Final = 0.72
"""Share of a gap's energy that a verdict must explain, half of the time [set on training cases]."""
OTHERWISE: Final = 0.05
"""Chance that even what is all explained is none of the catalogue [set on used-up exams]."""
TWINS: Final = {
    "bicycle.front_suspension": (0.25, "an IMU whose bracket bends"),
    "bicycle.tyre_compliance": (0.15, "an IMU whose bracket bends"),
    "steer.sensor_scale": (0.55, "tyres that slip sideways"),
    "imu.accel_x.sensor_scale": (0.25, "an IMU whose bracket bends"),
    "imu.accel_y.sensor_scale": (0.25, "an IMU whose bracket bends"),
    "lean.sensor_scale": (0.25, "an inclinometer that swings out in curves"),
}
"""The same of effects that something outside the catalogue looks like on any ride, and what that is: a
bracket that bends pitches the IMU when the fork would dive and turns gravity into its axes in proportion to
what they feel, tyres that slip sideways turn a bicycle less than its steer angle says, as a scale above 1
of that does, and an inclinometer that feels curves tells less of the lean that they need [set on used-up
exams and rides of another world: about half of these that were named were not there, most of them for such a
thing; of eight scales of the steer above 1, six were tyres]."""
OF_SETS: Final = 0.3
"""The same at most for sets, whose other effects would stand all the same."""
SLIGHT: Final = 0.1
"""By how much more than for that alone a cause may be in doubt, for the sentence to speak of it."""
LARGE: Final = 3.0
"""Floors from which on what the model of a gap may be off by is no more guessed but taken from the best."""
HOLDS: Final = 0.05
SEVERAL_HOLD: Final = 0.7
"""Held-out shrink below which one effect and a set are withdrawn: with two effects much can be bent to fit
what was seen [set on training cases]."""
AS_MUCH: Final = 1.15
"""Times what is left of the seen data, floors in each, that may be left of unseen ones."""
STRAIN: Final = 2.6
"""Prior standard deviations from which on a nuisance has gone further than calibrations leave anything."""
UNSAID: Final = 1.38
"""Floors, tolerances among them, from which on a signal is off although no candidate explains it: how well a
record tells its own noise, twice over [set on training cases]."""


def diagnose_rides(
    runs: Iterable[Run],
    rig: BicycleFile,
    *,
    references: Iterable[Run] = (),
    without: Collection[str] = (),
    seed: int = 0,
    report: Callable[[str], None] | None = None,
) -> Diagnosis:
    """Diagnose the gap between rides and the bicycle's model; arguments as of `hil.gap.diagnose`."""
    say = report or (lambda _: None)
    loaded, healthy = list(runs), list(references)
    nuisances: list[Nuisance] | None = None
    if healthy:
        say("calibrating on the healthy references")
        known = locate_rides(healthy, rig, seed=seed)
        nuisances = as_found(known, ride_nuisances(rig, known.evidence.problem))
    say("locating the gap")
    located = locate_rides(loaded, rig, nuisances=nuisances, seed=seed)
    chosen = nuisances or list(ride_nuisances(rig, located.evidence.problem))
    steps = {} if ROUNDED in without else coarse_steps_of_rides(loaded, rig)
    found = _explained(located, chosen, steps, without, seed, say)
    if (found.effects or not found.causes) and (far := _strained(found, located, chosen)):
        say(f"once more without what no calibration sets right: {', '.join(far)}")
        fewer = [n for n in chosen if n.name.rpartition(".")[0] not in far]
        anew = locate_rides(loaded, rig, nuisances=fewer, seed=seed)
        named = _explained(anew, fewer, steps, without, seed, say)
        if {(x.effect, x.location) for x in named.effects} > {
            (x.effect, x.location) for x in found.effects
        } and _is_further(named, chosen):
            return named
    return found


def _explained(
    located: Located,
    chosen: Sequence[Nuisance],
    steps: Mapping[str, float],
    without: Collection[str],
    seed: int,
    say: Callable[[str], None],
) -> Diagnosis:
    """The diagnosis of what was located with the nuisances `chosen`, beside the `steps` of its signals."""
    e = located.evidence
    sd = np.array([n.sd for n in chosen])
    floor = e.noise
    if steps:
        assert isinstance(e.problem, RideProblem)
        floor = with_steps(floor, e.problem, e.vector, steps, np.random.default_rng(seed + 3))

    def explained_with(noise: NoiseModel) -> tuple[Diagnosis, NoiseModel]:
        counted = with_tolerances(replace(e, noise=noise), sd, np.random.default_rng(seed + 1))
        # A candidate's own pattern tells it from noise long before the whole residual does: all are weighed.
        floors = counted.floor(e.problem)
        asked = replace(
            located,
            is_gap=True,
            signals=tuple(replace(s, noise_floor=floors[s.signal]) for s in located.signals),
            evidence=replace(e, noise=counted),
        )
        found = _weighed(asked, chosen, steps, without, seed, say)
        return found if found.verdict != "no_gap" else _unsaid(found), counted

    found, counted = explained_with(floor)
    if found.effects and max(s.ratio for s in located.signals) > LARGE:
        assert found.best is not None
        say("once more, by what the best candidate leaves")
        left = e.problem.residual(found.best.vector)
        found, counted = explained_with(tempered(floor, e.problem, left, 1.0))
    held = ~split(e.problem, counted, e.residual).train(e.problem)
    return _on_floor(replace(found, located=located), held, seed)


def _weighed(
    located: Located,
    chosen: Sequence[Nuisance],
    steps: Mapping[str, float],
    without: Collection[str],
    seed: int,
    say: Callable[[str], None],
) -> Diagnosis:
    """As `hil.gap.diagnose.consider` and a verdict, with the sets that rides ask for."""
    e = located.evidence
    parts = split(e.problem, e.noise, e.residual)
    c, none = begin(e, parts, chosen, {}, seed)
    say("computing what each candidate would do")
    bank = candidates_of(c, none, without)
    fits = fit_sets(c, none, Search(c, bank), bank.leaves, say)
    if steps:
        fits = rounded(c, fits, steps)
    held, is_large = ~parts.train(e.problem), stands(located, c, none)

    def answered(some: Sequence[Fit]) -> Diagnosis:
        every = [none, *some]
        told = _by_energy(answer(located, c, every, bank, held, parts.text, seed, is_large))
        if told.verdict != "unknown" or is_large or not told.causes:
            return told
        return replace(no_gap(located, parts.text), not_excited=told.not_excited)

    found = answered(fits[1:])
    if found.best is None or found.verdict != "unknown":
        return found
    # Something unknown beside an effect is no more likely than another effect: that costs no more then.
    larger = [f for f in fits if len(f.leaves) > len(found.best.leaves)]
    several = answered(larger) if larger else found
    if several.effects and several.effects[0].gain + MORE > found.causes[0].gain:
        return several
    return found


def _strained(found: Diagnosis, located: Located, chosen: Sequence[Nuisance]) -> list[str]:
    """`location.effect` of each nuisance that, beside what was found, went further than calibrations leave
    anything."""
    if found.best is not None and found.calibrated is not None:
        own = {name for leaf in found.best.leaves for name in leaf.parameters}
        names = [n.name for n in found.calibrated.nuisances]
        far = dict(zip(names, np.abs(found.best.z).tolist(), strict=True))
        far = {name: z for name, z in far.items() if name not in own}
    else:
        mean = {n.name: n.mean for n in chosen}
        far = {f.name: abs(f.change - mean[f.name]) / f.prior_sd for f in located.nuisances}
    return sorted({name.rpartition(".")[0] for name, z in far.items() if z > STRAIN})


def _is_further(named: Diagnosis, chosen: Sequence[Nuisance]) -> bool:
    """Whether each effect of `named` that is a nuisance too stands further than calibrations leave it."""
    assert named.calibrated is not None
    by_name, problem = {n.name: n for n in chosen}, named.calibrated.problem
    for x in named.effects:
        away = [
            abs(p.value - problem.base[problem.table.index(n.name)] - n.mean) / n.sd
            for k, p in x.parameters.items()
            if (n := by_name.get(f"{x.location}.{x.effect}.{k}")) is not None
        ]
        if away and max(away) < STRAIN:
            return False
    return True


def _on_floor(found: Diagnosis, held: Mask, seed: int) -> Diagnosis:
    """`found` with its shrinks, on `held` (N,) samples, from the measurement's own floor, as the gap is."""
    e, best, none, c = found.located.evidence, found.best, found.none, found.calibrated
    if best is None or none is None or c is None or found.score is None:
        return found
    before = e.problem.residual(none.vector)

    def again(f: Fit, signals: Sequence[str]) -> Score:
        after = e.problem.residual(f.vector)
        rng = np.random.default_rng(seed + 2)
        return score(e.problem, e.noise, before, after, held, signals, rng)

    def shown(cause: Cause) -> Cause:
        signals = touched(c, none, cause.fit) or e.problem.signals
        return widened(replace(cause, shrink=again(cause.fit, signals).shrink), c)

    causes = tuple(x if x.shrink is None else shown(x) for x in found.causes)
    by_name = {(x.effect, x.location): x for x in causes}
    effects = tuple(by_name[x.effect, x.location] for x in found.effects)
    part, sentence = again(best, found.score.signals), found.sentence
    if effects:
        _, sentence = judge(effects, causes, found.unknown, part.shrink)
        others = sorted({text for _, text in _twins(best)})
        sentence += "".join(f" On a ride {x} would look the same." for x in others)
    return replace(
        found,
        sentence=sentence,
        causes=causes,
        effects=effects,
        score=part,
        score_all=again(best, e.problem.signals),
    )


def _twins(best: Fit) -> list[tuple[float, str]]:
    """Of effects of a fit that something outside the catalogue looks like, its chance and its name."""
    value = dict(zip(best.names, best.values.tolist(), strict=True))
    turns_more = value.get("steer.sensor_scale.scale", math.inf) < 1.0
    most = 1.0 if len(best.leaves) == 1 else OF_SETS
    return [
        (min(TWINS[x.name][0], most), TWINS[x.name][1]) for x in best.leaves
        if x.name in TWINS and not (x.name == "steer.sensor_scale" and turns_more)
    ]  # fmt: skip


def _leaves_as_much(c: Calibrated, best: Fit, unseen: Score) -> bool:
    """Whether a fit leaves no more of unseen data than of the seen ones: what it takes off those then is
    little because little of it is there."""
    rng = np.random.default_rng(0)
    seen = score(c.problem, c.noise, best.residual, best.residual, c.train, unseen.signals, rng)
    return unseen.after * seen.floor <= AS_MUCH * seen.after * unseen.floor


def _unsaid(found: Diagnosis) -> Diagnosis:
    """`found`, no gap for want of a candidate; unknown where a signal stands above what noise and tolerances
    make of it."""
    over = {s.signal: s.ratio for s in found.located.signals}
    worst = max(over, key=lambda s: over[s])
    if over[worst] < UNSAID:
        return found
    sentence = (
        f"A gap that nothing in the catalogue explains: {worst} stands {over[worst]:.1f} times above what "
        "noise and a healthy bicycle's tolerances make of it, and no candidate has its pattern."
    )
    return replace(found, verdict="unknown", sentence=sentence, unknown=1.0)


def _by_energy(found: Diagnosis) -> Diagnosis:
    """The same with the chance of an unknown cause by the share of the gap's energy on the training data.

    A ride's gap stands in few seconds, tens of floors high; evidence counts in nats, in which those few
    seconds are little. What is left of the energy says whether a cause is missing.
    """
    c, none, best = found.calibrated, found.none, found.best
    if c is None or none is None or best is None or not found.causes:
        return found
    floors = c.noise.floor(c.problem)
    energy: dict[str, list[float]] = {}
    for x in c.problem.series:
        rows = c.problem.kept[x.part]
        sums = energy.setdefault(x.signal, [0.0, 0.0, 0.0])
        sums[0] += float(np.sum(none.residual[x.part][rows] ** 2)) / floors[x.signal] ** 2
        sums[1] += float(np.sum(best.residual[x.part][rows] ** 2)) / floors[x.signal] ** 2
        sums[2] += float(rows.sum())
    was = sum(max(before / n - 1.0, 0.0) for before, _, n in energy.values())
    left = sum(max(after / n - 1.0, 0.0) for _, after, n in energy.values())
    share = 1.0 - left / max(was, 1e-9)
    unseen = found.score
    worth = None if unseen is None or unseen.before <= STANDS * unseen.floor else unseen.shrink
    if unseen is not None and _leaves_as_much(c, best, unseen):
        worth = None if worth is None or worth < BORNE_OUT[0] else worth
    least, twin = max([(OTHERWISE, ""), *_twins(best)])
    others = other_than_steps(best)
    unknown = chance(share, least_explained(worth, EXPLAINED), least) if others else least
    if others and worth is not None and worth < (HOLDS if len(others) == 1 else SEVERAL_HOLD):
        unknown = max(unknown, 0.9)  # unseen data do not bear it out
    factor = (1.0 - unknown) / max(1.0 - found.unknown, 1e-12)
    causes = tuple(replace(x, probability=x.probability * factor) for x in found.causes)
    chosen = tuple(
        next(x for x in causes if (x.effect, x.location) == (leaf.effect, leaf.location))
        for leaf in best.leaves
    )
    shrink = None if unseen is None else unseen.shrink
    verdict, sentence = judge(chosen, causes, unknown, shrink)
    if verdict == "unknown" and unknown < least + SLIGHT:
        names = " and ".join(f"{x.effect.replace('_', ' ')} at {x.location}" for x in chosen)
        sentence = (
            f"A gap that something outside the catalogue makes more often than {names}, which these rides "
            f"cannot tell from it: {twin}."
        )
    return replace(
        found,
        verdict=verdict,
        sentence=sentence,
        causes=causes,
        effects=chosen if verdict != "unknown" else (),
        unknown=unknown,
    )
