"""Which effect makes the gap: candidates proposed, fitted through the twin, weighed, scored on held-out data.

The steps: locate the gap (after the nuisances, calibrated on healthy references where there are any); what
every candidate would do to every sample; the candidates, alone and together, that could explain it; fits of
the best of them; other twins that a healthy rig may be; evidence, classes, the chance that it is nothing in
the catalogue; shrink on data that no fit has seen. docs/gap.md says why each is done so.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import pandas as pd

from hil.config import RigFile
from hil.gap.catalogue.nuisances import Nuisance
from hil.gap.fits.frames import EFFECT as LOST
from hil.gap.judged.diagnosis import Diagnosis
from hil.gap.located.habits import DRAWS, HABITS, LINES
from hil.gap.located.locate import locate
from hil.gap.located.result import Located
from hil.gap.located.sanity import Finding, check_runs
from hil.gap.record.lines import CLEAR, UNTOLD, for_lines
from hil.gap.record.missing import Missing, missing_answers
from hil.gap.record.runs import as_runs
from hil.gap.rounds.older import as_it_was, by_itself
from hil.gap.rounds.question import Question, Report, nuisances_of
from hil.gap.rounds.round import Considered, considered
from hil.gap.rounds.twins import (
    TRANSMISSIONS,
    Habits,
    as_usual,
    on_springs,
    shown,
    with_guides,
    with_habits,
    with_ticks,
)
from hil.gap.rounds.usual import found as usually_found
from hil.gap.rounds.usual import with_usual
from hil.identify.replay import stretches
from hil.runs import Run

APART: Final = 1.6
"""Floors off the rig file's own twin, its drives as they are, from which on runs stand off it whatever their
references say [R]."""


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
    loaded, healthy = as_runs(runs, rig), as_runs(references, rig)
    found = consider(loaded, rig, references=healthy, without=without, seed=seed, report=report)
    answer = found.answer(seed)
    if answer.verdict != "unknown" or not healthy:
        return answer
    if report is not None:
        report("once more without the references")
    twin = rig.model_copy(update={"bus": found.rig.bus})
    seen = locate(loaded, twin, is_tried=True, seed=seed)
    if max(x.ratio for x in seen.signals) > APART:
        return answer
    alone = consider(loaded, rig, without=without, seed=seed, report=report, seen=seen).answer(seed)
    return by_itself(alone, answer) if alone.verdict == "no_gap" else answer


def consider(
    runs: Run | pd.DataFrame | Iterable[Run | pd.DataFrame],
    rig: RigFile,
    *,
    references: Run | pd.DataFrame | Iterable[Run | pd.DataFrame] = (),
    without: Collection[str] = (),
    seed: int = 0,
    report: Report | None = None,
    seen: Located | None = None,
) -> Considered:
    """All that `diagnose` says its verdict on; arguments as there. `seen`: what was located of these runs
    already."""
    given, loaded = rig, as_runs(runs, rig)
    healthy = as_runs(references, rig)
    missing = Missing() if LOST in without else missing_answers(loaded, healthy)
    q = Question(tuple(loaded), without, seed, report or (lambda _: None), missing)
    forced = [run for run in (*loaded, *healthy) if run.meta.mode == "force"]
    nats = for_lines(rig, [piece for run in forced for piece in stretches(run)])
    habits: Habits = [(DRAWS, 1.0)] if nats > CLEAR and DRAWS.may(rig) else []
    rig = DRAWS.twin(rig, 1.0) if habits else rig
    older: tuple[Finding, ...] = ()
    if healthy:
        q.say("calibrating on the healthy references")
        was = _shown_by(healthy, rig, without, seed, report)
        rig, older = was.located.evidence.problem.rig, was.told
        habits += was.habits
        known = as_found(was.located, nuisances_of(was.located.evidence.problem))
        q = replace(q, healthy=was.located, known=tuple(known))
    if seen is not None and seen.evidence.problem.rig == rig:
        located = seen
    else:
        q.say("locating the gap")
        located = q.locate(rig, is_tried=False)
    if not healthy:
        located, usual = as_usual(q, located, may_draw=UNTOLD < nats <= CLEAR)
        habits += usual
    mine = with_ticks(q, considered(q, located))
    mine, more = with_habits(q, mine, () if healthy else HABITS)
    habits += more
    mine = with_usual(q, mine)
    any_has = mine.usual
    own_way = usually_found(mine) if any_has else None
    mine, more = with_guides(q, mine)
    habits += more
    mine, springs = on_springs(q, mine)
    told = [h.found(mine.rig) for h, _ in habits]
    told += [f for f in (own_way, springs, *older) if f is not None]
    strange = set(check_runs(loaded, mine.rig)) - set(check_runs(loaded, given))
    # what is said of the files kept with runs is said of the file given, not of a twin's
    own = [f for f in mine.located.findings if f not in strange]
    located = replace(mine.located, findings=(*own, *told))
    return replace(mine, located=located, habits=tuple(habits), usual=any_has)


@dataclass(frozen=True, slots=True)
class _Shown:
    """A rig as its references show it."""

    located: Located
    """The references, beside the twin of that rig."""
    habits: Habits
    told: tuple[Finding, ...]
    """What the reader must know of it besides those."""


def _shown_by(
    healthy: Sequence[Run],
    rig: RigFile,
    without: Collection[str],
    seed: int,
    report: Report | None,
) -> _Shown:
    """The rig of healthy references: as its drives draw lines, and with all that explains what else those
    differ from the twin by."""

    def beside(twin: RigFile, *, is_tried: bool = True) -> Located:
        return locate(healthy, twin, is_tried=is_tried, seed=seed)

    found, habits = shown(beside, beside(rig, is_tried=False), LINES)
    rig = found.evidence.problem.rig
    if not found.is_gap:
        return _Shown(found, habits, ())
    if report is not None:
        report("the references differ from the twin themselves: what explains that comes first")
    first = consider(healthy, rig, without=without, seed=seed, report=report, seen=found)
    told = [f for f in first.located.findings if f.subject == TRANSMISSIONS]
    answer = first.answer(seed)
    if first.rig != rig:
        has_more = first.rig.effects != rig.effects
        rig, found = first.rig, beside(first.rig) if has_more else first.located
    if answer.verdict != "no_gap":
        effects, older = as_it_was(rig.effects, answer)
        found = beside(rig.model_copy(update={"effects": effects}))
        told.append(older)
    return _Shown(found, [*habits, *first.habits], tuple(told))


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
