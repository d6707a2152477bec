"""A value over the last while, kept so that a look at it costs little: it may be hundreds of points."""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from math import inf
from typing import Final

SPARE: Final = 256
"""Points that may be older than they need to be: they are dropped together."""


class Trail:
    """`times` (s, never falling) and `values`, oldest first; older ones than `keep_s` go now and then."""

    __slots__ = ("_keep_s", "_room", "times", "values")

    def __init__(self, keep_s: float) -> None:
        self.times: list[float] = []
        self.values: list[float] = []
        self._keep_s = keep_s
        self._room = SPARE

    def add(self, t_s: float, value: float) -> None:
        """The value at `t_s`."""
        self.times.append(t_s)
        self.values.append(value)
        self._room -= 1
        if self._room < 0:
            old = bisect_left(self.times, t_s - self._keep_s)
            del self.times[:old], self.values[:old]
            self._room = SPARE

    def clear(self) -> None:
        """Nothing is known."""
        self.times.clear()
        self.values.clear()

    def travel(self, from_s: float, to_s: float = inf) -> float:
        """Largest less smallest value between the instants, both included; 0 where there is none."""
        between = self.values[bisect_left(self.times, from_s) : bisect_right(self.times, to_s)]
        return max(between) - min(between) if between else 0.0
