"""Other twins of a healthy rig: drives with other ticks, habits, springs; taken where they explain better.

Before a cause is named they are asked whether the record is one of theirs: a stiff twin, or one whose
drives act elsewhere, calls what every machine has a fault.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Final

from hil.config import RigFile
from hil.gap.catalogue.sprung import BEND_HZ, BENDS_HZ, sprung_twin
from hil.gap.fits.evidence import FAINT, explains_better, weigh
from hil.gap.judged.clear import asked
from hil.gap.judged.diagnosis import Diagnosis
from hil.gap.located.habit import Habit, share_of
from hil.gap.located.habits import DRAWS, GUIDES, HABITS, LINES
from hil.gap.located.mount import mount_of
from hil.gap.located.result import Located
from hil.gap.located.sanity import Finding
from hil.gap.rounds.question import Question
from hil.gap.rounds.round import Considered, Glimpse, considered, glimpsed
from hil.gap.rounds.ticked import clocks_beside

SPRINGY: Final = ("compliance", "loop_gain")
"""What transmissions that give a little look like to a twin whose do not."""

GIVES: Final = frozenset({"compliance", "backlash"})
"""Effects that part a load from its motor."""

TRANSMISSIONS: Final = "transmissions"
"""What the reader is told of springs about."""

TURNS: Final = 3
"""Times that a plain habit is asked for its share: nuisances at their bounds stand for some of it first."""

Habits = list[tuple[Habit, float]]


def as_usual(q: Question, located: Located, *, may_draw: bool) -> tuple[Located, Habits]:
    """What was located, by a twin with habits that no effect is like where those leave no gap; and which.

    Habits that are plain are taken wherever they show, how lines are drawn even without a gap, for it may
    hide one. `may_draw`: drives do not say clearly that they
    draw out what force they are told.
    """
    asked = [h for h in HABITS if h.is_plain and (located.is_gap or h in LINES)]
    located, plain = shown(q.locate, located, asked)
    problem = located.evidence.problem
    rig = problem.rig
    unlike = [(h, share_of(h, located)) for h in HABITS if h.is_unlike and located.is_gap]
    if may_draw and located.is_gap and problem.are_forces and DRAWS.may(rig):
        unlike.append((DRAWS, 1.0))
    for habit, share in unlike:
        if share != 0.0:
            other = q.locate(habit.twin(rig, share), problem.clocks)
            if not other.is_gap:
                return other, [*plain, (habit, share)]
    return located, plain


def shown(
    locate: Callable[[RigFile], Located], located: Located, habits: Sequence[Habit]
) -> tuple[Located, Habits]:
    """What was located, by a twin with those of `habits` that show; and which. `locate`: the same records
    beside another rig file's twin."""
    found: Habits = []
    for habit in habits:
        for _ in range(TURNS):
            share = share_of(habit, located)
            if share == 0.0:
                break
            other = locate(habit.twin(located.evidence.problem.rig, share))
            if not habit.is_shown(other, located):
                break
            located, found = other, [*(x for x in found if x[0] is not habit), (habit, share)]
    return located, found


def with_ticks(q: Question, mine: Considered) -> Considered:
    """`mine`, or what explains better with the drives' ticks where its best fits show them."""
    if not mine.is_large or mine.explains_all():
        return mine
    clocks = clocks_beside(mine.located, mine.calibrated, mine.fits)
    if clocks is None:
        return mine
    q.say("once more with the drives' ticks where the best fit shows them")
    return _better(mine, considered(q, q.locate(mine.rig, clocks), mine.parts))


def with_habits(
    q: Question, mine: Considered, habits: Sequence[Habit] = HABITS
) -> tuple[Considered, Habits]:
    """`mine`, or what explains better with its IMU's mount and `habits` of its drives and legs; and which.

    A habit beside which the likeliest fits explain better is kept at a glimpse, and the next one asked for
    beside it: all candidates are looked at once, beside all of them.
    """
    found: Habits = []
    seen, glimpse = mine, None
    mount = mount_of(mine.located)
    for habit in habits if mount is None else (mount, *habits):
        # what leaves no less by itself does not with any candidate either
        has_left_no_less = habit.is_plain and habit.shows is None
        if has_left_no_less or (habit.is_unlike and seen.explains_all()):
            continue
        share = share_of(habit, seen.located)
        if share == 0.0:
            continue
        q.say(f"a glimpse of {habit.step}")
        next_one = glimpsed(q, seen, habit.twin(seen.rig, share))
        if not next_one.is_promising:
            continue
        if next_one.is_better:
            seen, glimpse = next_one.other, next_one
        else:
            other = _with(q, mine, next_one, [habit])
            if _better(seen, other) is seen:
                continue
            seen, glimpse = other, None
        found.append((habit, share))
    if glimpse is not None:
        seen = _with(q, mine, glimpse, [h for h, _ in found])
    return (seen, found) if _better(mine, seen) is not mine else (mine, [])


def _with(q: Question, mine: Considered, glimpse: Glimpse, habits: Sequence[Habit]) -> Considered:
    """All candidates of `mine` beside the twin of a `glimpse`, which has `habits`."""
    if _is_faint(mine) and _is_faint(glimpse.other):
        return glimpse.other
    q.say(f"once more with {' and '.join(h.step for h in habits)}")
    return considered(q, glimpse.located(q), mine.parts, mine.bank)


def _is_faint(x: Considered) -> bool:
    """Whether a gap is so small, and explained so poorly, that no further candidate is worth a look."""
    return not x.is_large and x.gain() < FAINT


def with_guides(q: Question, mine: Considered) -> tuple[Considered, Habits]:
    """`mine`, or what explains better with loads that rub in their guides, where its best fit has a
    transmission that gives and leaves some of the gap."""
    found: Habits = []
    for share in GUIDES.sizes if GUIDES.may(mine.rig) else ():
        weighed, _ = weigh(mine.calibrated, mine.fits)
        gives = any(leaf.effect in GIVES for leaf in weighed[0].fit.leaves)
        if not gives or mine.explains_all() or mine.gain() < asked(mine.calibrated).nats:
            break
        twin = GUIDES.twin(mine.rig, share)
        q.say(f"a glimpse of {GUIDES.step}")
        if not glimpsed(q, mine, twin).is_promising:
            break
        q.say(f"once more with {GUIDES.step}")
        other = considered(q, q.locate(twin), mine.parts, mine.bank)
        if _better(mine, other) is mine:
            break
        mine, found = replace(other, usual=mine.usual), [(GUIDES, share)]
    return mine, found


def on_springs(q: Question, mine: Considered) -> tuple[Considered, Finding | None]:
    """`mine`, or what loads that swing on their transmissions say; and what the reader is told of those."""
    if sprung_twin(mine.rig, BEND_HZ) == mine.rig:
        return mine, None  # references have shown them, or the rig file tells
    told = mine.answer(q.seed)
    if told.verdict == "no_gap" or (mine.is_large and not _may_be_springs(told)):
        return mine, None
    seen, glimpse, bend_hz = mine, None, 0.0
    for softer_hz in BENDS_HZ:
        q.say(f"a glimpse of transmissions that swing at {softer_hz:g} Hz, as healthy ones do")
        next_one = glimpsed(q, seen, sprung_twin(mine.rig, softer_hz))
        if not (next_one.is_promising or (glimpse is None and next_one.may_be_nothing)):
            break
        seen, glimpse, bend_hz = next_one.other, next_one, softer_hz
        if next_one.may_be_nothing:
            break
    if glimpse is None:
        return mine, None
    q.say(f"once more with transmissions that swing at {bend_hz:g} Hz")
    # located anew: beside the stiff twin's ticks a blow is smaller than it is
    other = considered(q, q.locate(glimpse.other.rig), mine.parts, mine.bank)
    is_better = _better(mine, other) is other
    is_worse = explains_better(other.calibrated, other.fits[:1], mine.fits)
    if is_springs(other.answer(q.seed), bend_hz, is_better=is_better, is_worse=is_worse):
        return other, _springs_found(bend_hz)
    return mine, None


def _better(mine: Considered, other: Considered) -> Considered:
    is_better = explains_better(mine.calibrated, mine.fits, other.fits)
    return other if is_better else mine


def _springs_found(bend_hz: float) -> Finding:
    return Finding(
        "info", TRANSMISSIONS,
        f"a twin whose loads swing on their transmissions at {bend_hz:g} Hz, as healthy ones do, explains "
        "what a stiff one does not: what is shown is that twin's",
    )  # fmt: skip


def is_springs(told: Diagnosis, bend_hz: float, *, is_better: bool, is_worse: bool) -> bool:
    """Whether the verdict of a twin on springs stands for that of the stiff one: on usual ones no gap is,
    or it explains better than the stiff one and names what is no spring.

    `is_worse`: springs alone explain less than what the stiff twin's verdict says, so no gap is none.
    """
    if told.verdict == "no_gap":
        return bend_hz == BEND_HZ and not is_worse
    return is_better and bool(told.effects) and not _is_springy(told)


def _may_be_springs(told: Diagnosis) -> bool:
    """Whether springs may be what a verdict names, or what an unknown cause leaves beside what is nearest."""
    return told.verdict == "unknown" or _is_springy(told)


def _is_springy(told: Diagnosis) -> bool:
    """Whether a verdict is what springs look like to a twin that has none."""
    return any(x.effect in SPRINGY for x in told.effects)
