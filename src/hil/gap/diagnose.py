"""Which effect makes the gap: candidates proposed, fitted through the twin, weighed, scored on held-out data.

The steps: locate the gap (after the nuisances, calibrated on healthy references where there are any); what
every candidate would do to every sample; the candidates, alone and together, that could explain it; fits of
the best of them; evidence, classes, the chance that it is nothing in the catalogue; shrink on data that no
fit has seen. docs/gap.md says why each is done so.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from hil.config import RigFile
from hil.gap.catalogue.bank import Bank
from hil.gap.catalogue.nuisances import Nuisance, default_nuisances
from hil.gap.catalogue.sprung import BEND_HZ, SOFTER_HZ, sprung_twin
from hil.gap.fits.evidence import explains_better, weigh
from hil.gap.fits.fitted import Calibrated, Fit
from hil.gap.fits.heldout import Split, split
from hil.gap.fits.rounded import rounded
from hil.gap.fits.shares import RARE, explained, most_left
from hil.gap.fits.training import begin, candidates_of
from hil.gap.floor.rounding import coarse_steps
from hil.gap.judged.calmer import calmed
from hil.gap.judged.diagnosis import Diagnosis
from hil.gap.judged.glimpsed import again, is_promising, may_be_nothing
from hil.gap.judged.older import as_it_was
from hil.gap.judged.ticked import clocks_beside
from hil.gap.judged.verdict import answer, stands
from hil.gap.located.habit import Habit, leaves_less, share_of
from hil.gap.located.habits import DRAWS, HABITS, LEADS
from hil.gap.located.locate import locate
from hil.gap.located.result import Located
from hil.gap.located.sanity import Finding, check_runs
from hil.gap.record.lines import CLEAR, UNTOLD, for_lines
from hil.gap.record.problem import Problem
from hil.gap.record.runs import as_runs
from hil.gap.search.candidates import fit_candidates, fitted_again
from hil.identify.replay import stretches
from hil.runs import Run

Report = Callable[[str], None]

SPRINGY: Final = ("compliance", "loop_gain")
"""What transmissions that give a little look like to a twin whose do not."""
ALL: Final = 0.95
"""Share of the gap from which on what explains it leaves nothing to ticks and habits."""


@dataclass(frozen=True, slots=True)
class Considered:
    """All that a verdict is made of: what was located, and the candidates that were fitted."""

    located: Located
    calibrated: Calibrated
    fits: tuple[Fit, ...]
    """The first is the twin without effects."""
    bank: Bank
    held: NDArray[np.bool_]
    """(N,) samples that no fit has seen."""
    held_out: str
    """What those are, in words."""
    is_large: bool
    """Whether the gap stands by itself, whatever explains it."""
    habits: tuple[tuple[Habit, float], ...] = ()
    """What the rig was found to have or do, unlike the rig file, and how much of it."""

    @property
    def rig(self) -> RigFile:
        """Of the twin."""
        return self.located.evidence.problem.rig

    def answer(self, seed: int = 0) -> Diagnosis:
        """The verdict on it."""
        return answer(
            self.located, self.calibrated, self.fits, self.bank, self.held, self.held_out, seed,
            self.is_large,
        )  # fmt: skip


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
    found = consider(runs, rig, references=references, without=without, seed=seed, report=report)
    return found.answer(seed)


def consider(
    runs: Run | pd.DataFrame | Iterable[Run | pd.DataFrame],
    rig: RigFile,
    *,
    references: Run | pd.DataFrame | Iterable[Run | pd.DataFrame] = (),
    without: Collection[str] = (),
    seed: int = 0,
    report: Report | None = None,
) -> Considered:
    """All that `diagnose` says its verdict on; arguments as there."""
    say = report or (lambda _: None)
    given, loaded = rig, as_runs(runs, rig)
    healthy = as_runs(references, rig)
    found, nuisances, older, springs = None, None, None, None
    forced = [run for run in (*loaded, *healthy) if run.meta.mode == "force"]
    nats = for_lines(rig, [piece for run in forced for piece in stretches(run)])
    habits: list[tuple[Habit, float]] = [(DRAWS, 1.0)] if nats > CLEAR and DRAWS.may(rig) else []
    rig = DRAWS.twin(rig, 1.0) if habits else rig
    if healthy:
        say("calibrating on the healthy references")
        found = locate(healthy, rig, seed=seed)
        if share_of(LEADS, found) > 0.0:
            early = locate(healthy, LEADS.twin(rig, 1.0), seed=seed)
            if leaves_less(early, found):
                habits.append((LEADS, 1.0))
                rig, found = early.evidence.problem.rig, early
        if found.is_gap:
            say("the references differ from the twin themselves: what explains that comes first")
            first = consider(healthy, rig, without=without, seed=seed, report=report)
            was = first.answer(seed)
            for habit, share in first.habits:
                rig, found = habit.twin(rig, share), first.located
            habits += first.habits
            if was.verdict != "no_gap":
                effects, older = as_it_was(rig.effects, was)
                rig = rig.model_copy(update={"effects": effects})
                found = locate(healthy, rig, seed=seed)
        nuisances = as_found(found, _nuisances(found.evidence.problem))
    say("locating the gap")
    located = locate(loaded, rig, nuisances=nuisances, healthy=found, seed=seed)
    if not healthy:
        located, usual = _as_usual(loaded, located, seed, may_draw=UNTOLD < nats <= CLEAR)
        habits += usual
    mine, parts = _considered(located, nuisances, without, seed, say)
    may_tick = mine.is_large and not _explains_all(mine)
    if may_tick and (clocks := clocks_beside(located, mine.calibrated, mine.fits)):
        say("once more with the drives' ticks where the best fit shows them")
        anew = locate(
            loaded, mine.rig, nuisances=nuisances, healthy=found, clocks=clocks, seed=seed
        )
        other, _ = _considered(anew, nuisances, without, seed, say, parts)
        if explains_better(mine.calibrated, mine.fits, other.fits):
            mine = other
    for habit in HABITS if not healthy else ():
        if habit.is_unlike and _explains_all(mine):
            continue
        share = share_of(habit, mine.located)
        if share == 0.0:
            continue
        twin = habit.twin(mine.rig, share)
        say(f"a glimpse of {habit.step}")
        if not _glimpsed(mine, loaded, twin, None, None, seed, parts)[0]:
            continue
        say(f"once more with {habit.step}")
        elsewise = locate(loaded, twin, seed=seed)
        other, _ = _considered(elsewise, None, without, seed, say, parts)
        if explains_better(mine.calibrated, mine.fits, other.fits):
            mine = other
            habits.append((habit, share))
    for bend_hz in (BEND_HZ, SOFTER_HZ) if _may_be_springs(mine, seed) else ():
        twin = sprung_twin(mine.rig, bend_hz)
        say(f"a glimpse of transmissions that swing at {bend_hz:g} Hz, as healthy ones do")
        if not any(_glimpsed(mine, loaded, twin, nuisances, found, seed, parts)):
            break
        say(f"once more with transmissions that swing at {bend_hz:g} Hz")
        soft = locate(loaded, twin, nuisances=nuisances, healthy=found, seed=seed)
        other, _ = _considered(soft, nuisances, without, seed, say, parts)
        told = other.answer(seed)
        is_better = explains_better(mine.calibrated, mine.fits, other.fits)
        if _is_springs(told, bend_hz, is_better=is_better):
            mine, springs = other, _springs_found(bend_hz)
        if springs is not None or not is_better:
            break
    known = [h.found(mine.rig) for h, _ in habits]
    known += [f for f in (springs, older) if f is not None]
    strange = set(check_runs(loaded, mine.rig)) - set(check_runs(loaded, given))
    # what is said of the files kept with runs is said of the file given, not of a twin's
    own = [f for f in mine.located.findings if f not in strange]
    located = replace(mine.located, findings=(*own, *known))
    return replace(mine, located=located, habits=tuple(habits))


def _considered(
    located: Located,
    nuisances: Sequence[Nuisance] | None,
    without: Collection[str],
    seed: int,
    say: Report,
    parts: Split | None = None,
) -> tuple[Considered, Split]:
    """What explains what was located, and which samples fits saw: those of `parts`, where they are given."""
    e = located.evidence
    whole = e.problem
    parts = parts or split(whole, e.noise, e.residual)
    chosen = tuple(nuisances or _nuisances(whole))
    steps = {} if "sensor_quantisation" in without else coarse_steps(whole, e.residual)
    c, none = begin(e, parts, chosen, steps, seed)
    say("computing what each candidate would do")
    bank = candidates_of(c, none, without)
    is_large = stands(located, c, none)
    fits = fit_candidates(c, none, bank, without, say)
    calm = calmed(located, c, fits, seed)
    if calm is not None:
        say("once more beside the noise that the best fit leaves")
        located = calm
        c, none = begin(calm.evidence, parts, chosen, steps, seed)
        fits = fitted_again(c, none, fits, bank, without, say)
    if steps:
        fits = rounded(c, fits, steps)
    held = ~parts.train(whole)
    return Considered(located, c, tuple(fits), bank, held, parts.text, is_large), parts


def _glimpsed(
    mine: Considered,
    loaded: Sequence[Run],
    twin: RigFile,
    nuisances: Sequence[Nuisance] | None,
    healthy: Located | None,
    seed: int,
    parts: Split,
) -> tuple[bool, bool]:
    """Whether another twin explains better, or leaves nothing to find, as far as the best candidates tell."""
    clocks = mine.located.evidence.problem.clocks
    there = locate(loaded, twin, nuisances=nuisances, healthy=healthy, clocks=clocks, seed=seed)
    chosen = tuple(nuisances or _nuisances(there.evidence.problem))
    c, none = begin(there.evidence, parts, chosen, {}, seed)
    seen = again(mine.calibrated, mine.fits, c, none)
    return is_promising(mine.calibrated, mine.fits, seen), may_be_nothing(c, seen)


def _as_usual(
    loaded: Sequence[Run], located: Located, seed: int, *, may_draw: bool
) -> tuple[Located, list[tuple[Habit, float]]]:
    """What was located, by a twin with habits that no effect is like where those leave no gap; and which.

    `may_draw`: drives do not say clearly that they draw out what force they are told.
    """
    problem = located.evidence.problem
    rig = problem.rig
    unlike = [(h, share_of(h, located)) for h in HABITS if h.is_unlike and located.is_gap]
    if may_draw and located.is_gap and problem.are_forces and DRAWS.may(rig):
        unlike.append((DRAWS, 1.0))
    for habit, share in unlike:
        if share != 0.0:
            other = locate(loaded, habit.twin(rig, share), clocks=problem.clocks, seed=seed)
            if not other.is_gap:
                return other, [(habit, share)]
    return located, []


def _explains_all(found: Considered) -> bool:
    """Whether the best fit leaves nothing of the gap: then no ticks, and no habit that no effect is like, can
    explain it better."""
    c, none = found.calibrated, found.fits[0]
    best = weigh(c, found.fits)[0][0].fit
    return bool(best.leaves) and explained(c, none, best) > ALL and most_left(c, best) < RARE


def _springs_found(bend_hz: float) -> Finding:
    return Finding(
        "info", "transmissions",
        f"a twin whose loads swing on their transmissions at {bend_hz:g} Hz, as healthy ones do, explains "
        "what a stiff one does not: what is shown is that twin's",
    )  # fmt: skip


def _may_be_springs(found: Considered, seed: int) -> bool:
    """Whether what was found is small, or what a stiff twin says of transmissions that give a little."""
    told = found.answer(seed)
    if told.verdict == "no_gap":
        return False
    return not found.is_large or _is_springy(told)


def _is_springs(told: Diagnosis, bend_hz: float, *, is_better: bool) -> bool:
    """Whether the verdict of a twin on springs stands for that of the stiff one: on usual ones no gap is,
    or it explains better than the stiff one and names what is no spring."""
    if told.verdict == "no_gap":
        return bend_hz == BEND_HZ
    return is_better and bool(told.effects) and not _is_springy(told)


def _is_springy(told: Diagnosis) -> bool:
    """Whether a verdict is what springs look like to a twin that has none."""
    return any(x.effect in SPRINGY for x in told.effects)


def _nuisances(problem: Problem) -> tuple[Nuisance, ...]:
    return default_nuisances(problem.rig, problem.signals, are_forces=problem.are_forces)


def as_found(found: Located, priors: Sequence[Nuisance]) -> list[Nuisance]:
    """Nuisances as references leave them: where they stand, and as wide as they may still drift.

    `found`: the references located with `priors`.
    """
    by_name = {n.name: n for n in priors}
    out = []
    for f in found.nuisances:
        n = by_name[f.name]
        out.append(replace(n, mean=f.change, sd=float(np.hypot(f.sd, n.drift * n.sd))))
    return out
