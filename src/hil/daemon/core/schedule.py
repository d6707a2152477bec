"""When a cycle begins and when each drive's slot in it starts; what was late and what was missed.

Pure: told the time, it says what is due. A late caller gets everything of the present cycle at once; whole
cycles that have gone by are counted as overruns and skipped, never made up for in a burst of frames.
"""

from __future__ import annotations

from typing import Final, NamedTuple

SYNC: Final = -2
"""`Due.slot` of the instant at which a cycle begins for the drives: it comes alone, ahead of the cycle."""
CYCLE: Final = -1
"""`Due.slot` of the start of a cycle; drives' slots count from 0."""


class Due(NamedTuple):
    """Something to do now: the start of a cycle (slot == CYCLE) or a drive's slot."""

    slot: int
    due_s: float


class Schedule:
    """Cycle k begins at start + k·cycle; the slot of drive i `i * stagger_s` later.

    With `synchronous` a SYNC is due with each cycle, in a call of its own: what follows has to be reckoned
    first, and SYNC must not wait for that. Where the rest of a cycle comes so late that the next one has
    begun, it is missed: its setpoints would crowd the next one's.
    """

    def __init__(
        self,
        start_s: float,
        cycle_s: float,
        stagger_s: float,
        slots: int,
        *,
        synchronous: bool = False,
    ) -> None:
        if stagger_s * (slots - 1) >= cycle_s:
            raise ValueError(
                f"{slots} slots {stagger_s * 1e3:g} ms apart do not fit into a cycle of {cycle_s * 1e3:g} ms"
            )
        self.start_s = start_s
        self.cycle_s = cycle_s
        self.stagger_s = stagger_s
        self.slots = slots
        self.cycles = 0
        self.overruns = 0
        self.missed_in_a_row = 0
        self._first = SYNC if synchronous else CYCLE
        self._k = self._unsent = 0
        self._next = self._first

    @property
    def next_due_s(self) -> float:
        """Instant of the next thing to do, s."""
        return self._due_s(self._k, self._next)

    def take(self, now_s: float) -> list[Due]:
        """All that is due at `now_s`, in order."""
        due: list[Due] = []
        while (due_s := self.next_due_s) <= now_s:
            if self._next == CYCLE != self._first and now_s - due_s >= self.cycle_s:
                self._miss()
                continue
            if self._next == self._first:
                if due and self._first == SYNC:
                    return due
                self._begin(now_s)
                due, due_s = [], self.next_due_s
            due.append(Due(self._next, due_s))
            self._next += 1
            if self._next == self.slots:
                self._k, self._next, self._unsent = self._k + 1, self._first, 0
            if due[-1].slot == SYNC:
                return due
        return due

    def _begin(self, now_s: float) -> None:
        gone = int((now_s - self._due_s(self._k, SYNC)) / self.cycle_s)
        self._k += gone
        self.overruns += gone
        self.missed_in_a_row = self._unsent + gone
        self.cycles += 1

    def _miss(self) -> None:
        self._k, self._next = self._k + 1, self._first
        self._unsent += 1
        self.cycles -= 1
        self.overruns += 1

    def _due_s(self, k: int, slot: int) -> float:
        return self.start_s + k * self.cycle_s + max(slot, 0) * self.stagger_s
