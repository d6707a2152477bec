"""The ends of a simulated drive's stroke: where it stops itself, and how it is brought back."""

from __future__ import annotations

from typing import Final

from hil.sim.senses import Senses

SLACK_M: Final = 1e-3
"""A drive reset beyond the end of its stroke may move so much further out before it stops again [M]."""


class Course:
    """Whether a drive has left its stroke, as its course limitation sees it."""

    def __init__(self, senses: Senses) -> None:
        self._senses = senses
        self._allowance = 0.0

    def reset(self) -> None:
        """A fault is reset: from beyond the end it may be brought back."""
        self._allowance = self._senses.beyond_course() + SLACK_M

    def is_left(self) -> bool:
        """Whether it stands beyond an end, and further than it may since its reset."""
        beyond = self._senses.beyond_course()
        if beyond == 0.0:
            self._allowance = 0.0
        return beyond > self._allowance
