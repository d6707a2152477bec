"""The parameter channel in slots: one question a drive and slot, one in flight, none left out.

Configuration and measurement share the channel: a slot carries the configuration's question while there is
one, else the next of the declared pattern. What the drive wants repeated, and what it left unanswered, is
asked again before anything else, if it insists ("Parameters Identification for Motorcycle Simulator's
Platform Characterization", section 6.1: a request and its answer fill one 10 ms slot).
"""

from __future__ import annotations

from typing import Generic, Protocol, TypeVar


class Question(Protocol):
    """What a slot can carry; `number` names it in the answer."""

    @property
    def number(self) -> int:
        """Number of the parameter asked for."""

    @property
    def insists(self) -> bool:
        """It is asked again at once where it was not answered, or is to be repeated."""


Q = TypeVar("Q", bound=Question)


class SlotScheduler(Generic[Q]):
    """Decides what each slot of one drive asks, and which answers belong to a question."""

    def __init__(self, pattern: tuple[Q, ...], answer_wait_s: float) -> None:
        self._pattern = pattern
        self._answer_wait_s = answer_wait_s
        self._turn = 0
        self._in_flight: Q | None = None
        self._again: Q | None = None
        self._asked_s = 0.0
        self.turns = 0
        """Turns of the pattern that were asked in full."""
        self.slots = 0
        self.pairs = 0
        self.repeats = 0
        self.repeats_in_row = 0
        self.timeouts = 0
        self.unasked = 0
        self.surplus = 0
        """Answers less questions since the last reset."""

    def reset(self) -> None:
        """Forget what is in flight, as after a restart of the drive. Counters stay."""
        self._in_flight = self._again = None
        self._turn = 0
        self.repeats_in_row = self.surplus = 0

    def ask(self, now_s: float, first: Q | None) -> Q | None:
        """The question for this slot; `first` goes before the pattern.

        None only where the last question may still be answered: never with slots longer than the wait.
        """
        self.slots += 1
        question: Q
        if self._in_flight is not None:
            if now_s - self._asked_s < self._answer_wait_s:
                return None
            self.timeouts += 1
            self._again = self._in_flight if self._in_flight.insists else None
        if self._again is not None:
            question = self._again
        elif first is not None:
            question = first
        else:
            question = self._pattern[self._turn]
            self._turn = (self._turn + 1) % len(self._pattern)
            self.turns += self._turn == 0
        self._in_flight, self._again, self._asked_s = question, None, now_s
        self.surplus -= 1
        return question

    def answered(self, number: int, *, repeat: bool) -> Q | None:
        """The question that an answer belongs to; None, counted, where nothing such was asked.

        With `repeat` the same question goes out again in the next slot, if it insists.
        """
        self.surplus += 1
        question = self._in_flight
        if question is None or question.number != number:
            self.unasked += 1
            return None
        self._in_flight = None
        self.pairs += 1
        if not repeat:
            self.repeats_in_row = 0
            return question
        self.repeats += 1
        if question.insists:
            self._again = question
            self.repeats_in_row += 1
        return question
