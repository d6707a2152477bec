"""Which effect makes the gap of a ride: the steps of `hil.gap.diagnose`, on the bicycle's candidates."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hil.config import BicycleFile
from hil.gap.bicycle.follows import follows
from hil.gap.bicycle.intervals import beyond_usual
from hil.gap.bicycle.locate import locate_rides
from hil.gap.bicycle.noise import SLOW, tempered, with_tolerances
from hil.gap.bicycle.nuisances import ride_nuisances
from hil.gap.bicycle.problem import RideProblem
from hil.gap.bicycle.road import slopes_of
from hil.gap.bicycle.rounding import coarse_steps_of_rides, with_steps
from hil.gap.bicycle.roundness import once_a_turn
from hil.gap.bicycle.sets import fit_alone, fit_sets
from hil.gap.bicycle.strained import exceeds_calibration, held_still, names_more, strained
from hil.gap.bicycle.verdict import (
    by_energy,
    is_usual,
    standing,
    told_by,
    twins,
    unsaid,
    with_road,
)
from hil.gap.bicycle.warming import Warm, warms_up
from hil.gap.bicycle.wheels import Wheels
from hil.gap.catalogue.nature import RIDER
from hil.gap.catalogue.nuisances import Nuisance
from hil.gap.diagnose import as_found
from hil.gap.fits.facts import EFFECT as ROUNDED
from hil.gap.fits.facts import left_by, rounded
from hil.gap.fits.fitted import Fit
from hil.gap.fits.heldout import Score, score, split, touched
from hil.gap.fits.training import begin, candidates_of
from hil.gap.floor.noise import NoiseModel
from hil.gap.judged.diagnosis import Cause, Diagnosis
from hil.gap.judged.verdict import answer, attributed, no_gap, or_several, stands
from hil.gap.located.result import Located
from hil.gap.located.sanity import Finding
from hil.gap.record.problem import Mask
from hil.gap.rounds.older import as_it_was
from hil.gap.search.linear import Search
from hil.rigs.bicycle import with_usual_rider
from hil.runs import Run

Array = NDArray[np.float64]

LARGE: Final = 3.0
"""Floors from which on what the model of a gap may be off by is no more guessed but taken from the best."""
TURNS: Final = 2
"""Times that is done: the first time the best is still one of a model that may be off by much."""
WANDERING: Final = Finding(
    "info", "noise",
    "may wander: more stands in the signals than white noise leaves, but it does not follow from how it was "
    "ridden; the floor holds noise that lasts for tenths of a second as well",
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class _Question:
    """What is asked: of which rides, beside what, and how."""

    rides: Sequence[Run]
    rig: BicycleFile
    nuisances: Sequence[Nuisance] | None
    """As references left them; None where there are none."""
    without: Collection[str]
    seed: int
    say: Callable[[str], None]


def diagnose_rides(
    runs: Iterable[Run],
    rig: BicycleFile,
    *,
    references: Iterable[Run] = (),
    without: Collection[str] = (),
    seed: int = 0,
    report: Callable[[str], None] | None = None,
) -> Diagnosis:
    """Diagnose the gap between rides and the bicycle's model; arguments as of `hil.gap.diagnose`.

    Where the file says nothing of a rider, the lean torque is no equation to be judged by: who knows what
    leans. Only where nothing else explains a gap, or there is none, is a usual rider asked.
    """
    say = report or (lambda _: None)
    loaded, healthy = list(runs), list(references)
    found = _diagnosed(loaded, rig, healthy, without, seed, say)
    ridden = with_usual_rider(rig)
    if ridden is None or found.effects or RIDER in without:
        return found
    say("once more with a usual rider, of whom the rig file says nothing")
    other = _diagnosed(loaded, ridden, healthy, without, seed, say)
    if all(x.effect != RIDER for x in other.effects):
        return found
    told = Finding(
        "warning", "rider",
        f"is not in the rig file: an upper body of {ridden.rider.mass:g} kg that turns "
        f"{ridden.rider.pivot[2]:.2g} m above the axle is assumed, and what is found of it goes with that",
    )  # fmt: skip
    located = replace(other.located, findings=(*other.located.findings, told))
    return replace(other, located=located)


def _diagnosed(
    loaded: Sequence[Run],
    rig: BicycleFile,
    healthy: Sequence[Run],
    without: Collection[str],
    seed: int,
    say: Callable[[str], None],
) -> Diagnosis:
    """The diagnosis with the file's own rider, if it has one."""
    nuisances: list[Nuisance] | None = None
    wheels: Wheels | None = None
    older: Finding | None = None
    is_old_wheel, is_old_warmth = False, False
    if healthy:
        say("calibrating on the healthy references")
        known = _as_ridden(healthy, rig, seed)
        if known.is_gap:
            say("the references differ from the model themselves: what explains that comes first")
            was = _diagnosed(healthy, rig, (), without, seed, say)
            if was.verdict != "no_gap":
                effects, older = as_it_was(rig.effects, was)
                rig = rig.model_copy(update={"effects": effects})
                known = _as_ridden(healthy, rig, seed)
        wheels = _rides(known).wheels
        is_old_wheel = once_a_turn(_rides(known).rides) is not None
        is_old_warmth = warms_up(known, known.evidence.residual) is not None
        nuisances = as_found(known, ride_nuisances(rig, _rides(known)))
    q = _Question(loaded, rig, nuisances, without, seed, say)

    def on(slow: float, wheels: Wheels | None) -> tuple[Diagnosis, tuple[Finding, ...]]:
        level = _on_road(q, (), slow, wheels)
        if not (slopes := _road(level.located, level.best)):
            return level, ()
        say("once more on roads that rise and fall")
        rolling = _on_road(q, slopes, slow, _rides(level.located).wheels)
        return rolling, (_rolling(slopes),)

    say("locating the gap")
    found, findings = on(0.0, wheels)
    left = _rides(found.located).residual(_vector(found))
    warm = None if is_old_warmth else warms_up(found.located, left)
    if warm is not None and _is_alone(found, warm):
        found = told_by(found, warm.text)
    if found.verdict == "unknown" and warm is None:
        say("once more with sensors whose noise wanders")
        calmer, told = on(SLOW, _rides(found.located).wheels)
        if calmer.verdict != "unknown" and not _still_follows(calmer, found.located.evidence.noise):
            found, findings = calmer, (*told, WANDERING)
    beats = once_a_turn(_rides(found.located).rides)
    if beats is not None and not is_old_wheel and found.verdict == "no_gap":
        found = told_by(found, beats)
    if older is not None:
        findings = (older, *findings)
    located = replace(found.located, findings=(*found.located.findings, *findings))
    return replace(found, located=located)


def _as_ridden(runs: Sequence[Run], rig: BicycleFile, seed: int) -> Located:
    """Where rides differ from the model, on the roads that they were ridden on."""
    level = locate_rides(runs, rig, seed=seed)
    slopes = _road(level, None)
    return locate_rides(runs, rig, seed=seed, slopes=slopes) if slopes else level


def _rides(located: Located) -> RideProblem:
    """The rides that were located."""
    problem = located.evidence.problem
    assert isinstance(problem, RideProblem)
    return problem


def _vector(found: Diagnosis) -> Array:
    """(P,) the twin with the effects that were found, or with the nuisances alone."""
    if found.effects and found.best is not None:
        return found.best.vector
    return found.located.evidence.vector


def _is_alone(found: Diagnosis, warm: Warm) -> bool:
    """Whether nothing is named beside a zero that goes one way but a bias that stands for it."""
    return {(x.effect, x.location) for x in found.effects} <= {("sensor_bias", warm.signal)}


def _road(located: Located, best: Fit | None) -> list[Array]:
    """Slopes of the rides' roads, as what `best` leaves asks for them, or the nuisances alone; none where
    roads may be level."""
    e, problem = located.evidence, _rides(located)
    vector = e.vector if best is None else best.vector
    left = e.residual if best is None else problem.residual(vector)
    return slopes_of(problem, e.noise, vector, left)


def _still_follows(found: Diagnosis, noise: NoiseModel) -> bool:
    """Whether what a diagnosis leaves follows from how it was ridden, in floors of `noise`."""
    problem = _rides(found.located)
    vector = _vector(found)
    return follows(problem, noise, vector, problem.residual(vector)) is not None


def _rolling(slopes: Sequence[Array]) -> Finding:
    steepest = max(float(np.std(s)) for s in slopes)
    return Finding(
        "info", "road",
        f"rises and falls by {1e3 * steepest:.1f} thousandths (rms), as the acceleration along says: the "
        "twin rides that road",
    )  # fmt: skip


def _on_road(
    q: _Question, slopes: Sequence[Array], slow: float, wheels: Wheels | None
) -> Diagnosis:
    """The diagnosis on roads of such slopes, level ones where there are none, with so much of the noise slow
    besides, on such wheels, or those that the rides tell."""

    def located_with(nuisances: Sequence[Nuisance] | None, wheels: Wheels | None) -> Located:
        return locate_rides(
            q.rides, q.rig, nuisances=nuisances, seed=q.seed, slopes=slopes, slow=slow,
            wheels=wheels,
        )  # fmt: skip

    located = located_with(q.nuisances, wheels)
    problem = _rides(located)
    chosen = q.nuisances or list(ride_nuisances(q.rig, problem))
    steps = {} if ROUNDED in q.without else coarse_steps_of_rides(q.rides, q.rig)
    found = _explained(q, located, chosen, steps)
    if far := strained(found, located, chosen):
        q.say(f"once more without what no calibration sets right: {', '.join(far)}")
        fewer = [held_still(n) if n.name.rpartition(".")[0] in far else n for n in chosen]
        named = _explained(q, located_with(fewer, problem.wheels), fewer, steps)
        if names_more(named, found) and exceeds_calibration(named, chosen):
            return named
    return found


def _explained(
    q: _Question, located: Located, chosen: Sequence[Nuisance], steps: Mapping[str, float]
) -> Diagnosis:
    """The diagnosis of what was located with the nuisances `chosen`, beside the `steps` of its signals."""
    e, problem = located.evidence, _rides(located)
    sd = np.array([n.sd for n in chosen])
    floor = e.noise
    if steps:
        floor = with_steps(floor, problem, e.vector, steps, np.random.default_rng(q.seed + 3))

    def explained_with(noise: NoiseModel) -> tuple[Diagnosis, NoiseModel]:
        rng = np.random.default_rng(q.seed + 1)
        counted = with_tolerances(noise, problem, e.vector, e.jacobian, sd, rng)
        # A candidate's own pattern tells it from noise long before the whole residual does: all are weighed.
        floors = counted.floor(e.problem)
        asked = replace(
            located,
            is_gap=True,
            signals=tuple(
                replace(s, noise_floor=with_road(s.signal, floors[s.signal]))
                for s in located.signals
            ),
            evidence=replace(e, noise=counted),
        )
        found = _weighed(q, asked, floor, chosen, steps)
        return found if found.verdict != "no_gap" else unsaid(found), counted

    found, counted = explained_with(floor)
    is_large = max(s.ratio for s in located.signals) > LARGE
    for _ in range(TURNS):
        if not found.effects or not is_large:
            break
        assert found.best is not None
        q.say("once more, by what the best candidate leaves")
        left = e.problem.residual(found.best.vector)
        found, counted = explained_with(tempered(floor, e.problem, left, 1.0))
    held = ~split(e.problem, counted, e.residual).train(e.problem)
    return _on_floor(replace(found, located=located), held, q.seed)


def _weighed(
    q: _Question,
    located: Located,
    measured: NoiseModel,
    chosen: Sequence[Nuisance],
    steps: Mapping[str, float],
) -> Diagnosis:
    """As `hil.gap.diagnose.consider` and a verdict, with the sets that rides ask for; `measured`: the floor
    without the tolerances that `located` counts with."""
    e = located.evidence
    parts = split(e.problem, e.noise, e.residual)
    c, none = begin(e, parts, chosen, {}, q.seed)
    q.say("computing what each candidate would do")
    bank = candidates_of(c, none, q.without)
    search = Search(c, bank)
    held = ~parts.train(e.problem)
    is_large = stands(located, c, none)
    # What is a gap without a candidate is one with whichever explains it.
    is_gap = is_large or bool(standing(located))

    def answered(some: Sequence[Fit]) -> Diagnosis:
        every = [none, *some]
        told = by_energy(
            answer(located, c, every, bank, held, parts.text, q.seed, is_gap), measured
        )
        if is_usual(told, q.rig):
            sentence = "No gap but what any healthy bicycle and its sensors have."
            usual = replace(no_gap(located, parts.text), sentence=sentence)
            return replace(usual, not_excited=told.not_excited)
        if told.verdict != "unknown" or is_large or not told.causes:
            return told
        return replace(no_gap(located, parts.text), not_excited=told.not_excited)

    def grown(known: Sequence[Fit], is_missing: bool) -> list[Fit]:
        return fit_sets(c, none, known, search, bank.leaves, q.say, is_missing)

    def stepped(some: list[Fit]) -> list[Fit]:
        return rounded(c, some, steps) if steps else some

    sets = grown(fit_alone(c, search, bank.leaves, q.say), is_missing=False)
    fits = stepped(sets)
    found = answered(fits[1:])
    if found.causes:
        q.say("looking for what acts beside it")
        fits = stepped(grown(sets[1:], is_missing=True))
        further = answered(fits[1:])
        found = further if len(further.effects) > len(found.effects) else found
    return or_several(found, fits[1:], answered)


def _on_floor(found: Diagnosis, held: Mask, seed: int) -> Diagnosis:
    """`found` with its shrinks, on `held` (N,) samples, from the measurement's own floor, as the gap is."""
    e, best, none, c = found.located.evidence, found.best, found.none, found.calibrated
    if best is None or none is None or c is None or found.score is None:
        return found
    before = e.problem.residual(none.vector)

    def again(f: Fit, signals: Sequence[str]) -> Score:
        after = left_by(e.problem, f, ~held)
        rng = np.random.default_rng(seed + 2)
        return score(e.problem, e.noise, before, after, held, signals, rng)

    def shown(cause: Cause) -> Cause:
        signals = touched(c, none, cause.fit) or e.problem.signals
        return beyond_usual(replace(cause, shrink=again(cause.fit, signals).shrink), c)

    causes = tuple(x if x.shrink is None else shown(x) for x in found.causes)
    by_name = {(x.effect, x.location): x for x in causes}
    effects = tuple(by_name[x.effect, x.location] for x in found.effects)
    part, sentence = again(best, found.score.signals), found.sentence
    if effects:
        _, sentence = attributed(effects, causes, found.unknown, part.shrink)
        others = sorted({text for _, text in twins(c, none, best)})
        sentence += "".join(f" On a ride {x} would look the same." for x in others)
    return replace(
        found,
        sentence=sentence,
        causes=causes,
        effects=effects,
        score=part,
        score_all=again(best, e.problem.signals),
    )
