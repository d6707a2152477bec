"""One round of a diagnosis: all candidates beside one twin, weighed; or a glimpse of another twin."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hil.config import Effect, RigFile
from hil.gap.catalogue.bank import Bank
from hil.gap.fits.evidence import explains_better, gain, weigh
from hil.gap.fits.facts import missed, rounded
from hil.gap.fits.fitted import Calibrated, Fit
from hil.gap.fits.heldout import Split, split
from hil.gap.fits.shares import RARE, explained, most_left
from hil.gap.fits.training import begin, candidates_of
from hil.gap.floor.rounding import coarse_steps
from hil.gap.judged.diagnosis import Diagnosis
from hil.gap.judged.verdict import answer, or_several, stands
from hil.gap.located.habit import Habit
from hil.gap.located.result import Located
from hil.gap.record.missing import Missing
from hil.gap.rounds.calmer import calmed
from hil.gap.rounds.glimpsed import again, may_be_nothing
from hil.gap.rounds.question import Question
from hil.gap.rounds.ticked import may_lie_elsewhere
from hil.gap.search.candidates import fit_candidates, fitted_again

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
    parts: Split
    """Which samples fits saw."""
    is_large: bool
    """Whether the gap stands by itself, whatever explains it."""
    missing: Missing
    """The drives' answers that never came."""
    habits: tuple[tuple[Habit, float], ...] = ()
    """What the rig was found to have or do, unlike the rig file, and how much of it."""
    usual: tuple[Effect, ...] = ()
    """Effects that the twin has because any rig has so much of them."""

    @property
    def rig(self) -> RigFile:
        """Of the twin."""
        return self.located.evidence.problem.rig

    @property
    def held(self) -> NDArray[np.bool_]:
        """Samples (N,) that no fit saw."""
        return ~self.parts.train(self.located.evidence.problem)

    def answer(self, seed: int = 0) -> Diagnosis:
        """The verdict on it."""
        none, *fits = missed(self.fits, self.missing)

        def answered(some: Sequence[Fit]) -> Diagnosis:
            return answer(
                self.located, self.calibrated, [none, *some], self.bank, self.held,
                self.parts.text, seed, self.is_large,
            )  # fmt: skip

        return or_several(answered(fits), fits, answered)

    def gain(self) -> float:
        """Nats of the likeliest fit over that without effects."""
        return gain(weigh(self.calibrated, self.fits)[0])

    def explains_all(self) -> bool:
        """Whether the best fit leaves nothing of the gap: then no ticks, and no habit that no effect is like,
        can explain it better."""
        best = weigh(self.calibrated, self.fits)[0][0].fit
        share = explained(self.calibrated, self.fits[0], best)
        return bool(best.leaves) and share > ALL and most_left(self.calibrated, best) < RARE


@dataclass(frozen=True, slots=True)
class Glimpse:
    """Another twin beside the few best candidates of the first."""

    other: Considered
    """Of those candidates alone."""
    is_better: bool
    """Whether it explains better with the best of them."""
    is_promising: bool
    """Whether it explains better with effects or none."""
    may_be_nothing: bool
    """Whether it leaves nothing to find."""

    def located(self, q: Question) -> Located:
        """What it locates; with ticks looked for beside it, where there is a gap that those may be off by."""
        seen, e = self.other, self.other.located.evidence
        is_off = seen.is_large and may_lie_elsewhere(e.problem, e.vector)
        return q.locate(seen.rig) if is_off else seen.located


def considered(
    q: Question, located: Located, parts: Split | None = None, known: Bank | None = None
) -> Considered:
    """What explains what was located; fits see the samples of `parts`, where they are given. `known`: what
    candidates do to another twin of the same record."""
    e = located.evidence
    whole = e.problem
    parts = parts or split(whole, e.noise, e.residual)
    chosen = q.nuisances(whole)
    steps = {} if "sensor_quantisation" in q.without else coarse_steps(whole, e.residual)
    c, none = begin(e, parts, chosen, steps, q.seed)
    q.say("computing what each candidate would do")
    bank = candidates_of(c, none, q.without, known)
    is_large = stands(located, c, none)
    fits = fit_candidates(c, none, bank, is_large, q.without, q.say)
    calm = calmed(located, c, fits, q.seed)
    if calm is not None:
        q.say("once more beside the noise that the best fit leaves")
        located = calm
        c, none = begin(calm.evidence, parts, chosen, steps, q.seed)
        fits = fitted_again(c, none, fits, bank, is_large, q.without, q.say)
    if steps:
        fits = rounded(c, fits, steps)
    return Considered(located, c, tuple(fits), bank, parts, is_large, q.missing)


def glimpsed(q: Question, mine: Considered, twin: RigFile) -> Glimpse:
    """What another twin would say, as far as the best candidates of `mine` tell.

    Where drives draw lines otherwise, ticks are looked for if those of `mine` showed none.
    """
    clocks = mine.located.evidence.problem.clocks
    draws_alike = twin.bus.interpolation == mine.rig.bus.interpolation
    near = (clocks, mine.located) if clocks or draws_alike else (None, None)
    there = q.locate(twin, *near)
    chosen = q.nuisances(there.evidence.problem)
    c, none = begin(there.evidence, mine.parts, chosen, {}, q.seed)
    seen = again(mine.calibrated, mine.fits, c, none)
    other = Considered(
        there, c, tuple(seen), mine.bank, mine.parts, stands(there, c, none), q.missing
    )
    is_better = explains_better(mine.calibrated, mine.fits, seen)
    is_promising = is_better or explains_better(mine.calibrated, mine.fits[:1], seen[:1])
    return Glimpse(other, is_better, is_promising, may_be_nothing(c, seen))
