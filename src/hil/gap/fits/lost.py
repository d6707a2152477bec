"""Frames that were lost, of each drive: how many, whether at once, and bursts of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hil.identify.replay import Stretch

Lost = dict[str, NDArray[np.int64]]
"""Of each drive of a stretch the numbers of its lost setpoints, in order."""

ABOUT: Final = (-1, 0, 1)
"""Frames by which the first and the last one found may be off."""
LENGTHS: Final = (2, 3, 4, 6, 8)
GATHER: Final = 20
"""Frames from one lost one to the next up to which they may be what is found of one burst."""


@dataclass(frozen=True, slots=True)
class Burst:
    """Lost frames of one drive near each other, of so many `frames` sent to it."""

    stretch: int
    actuator: str
    first: int
    last: int
    lost: int
    """How many of those from the first to the last are."""
    frames: int

    def runs(self) -> list[NDArray[np.int64]]:
        """Frames in a row that may be lost in place of those found: from about the first one on, for as long
        as LENGTHS; or from about the first to about the last. The first setpoint of all always arrives."""
        ends = [(a, self.first + a + n - 1) for a in ABOUT for n in LENGTHS]
        ends += [(a, self.last + b) for a in ABOUT for b in ABOUT]
        return [np.arange(max(self.first + a, 1), min(end, self.frames - 1) + 1) for a, end in ends]


def bursts_of(lost: Sequence[Lost], pieces: Sequence[Stretch]) -> list[Burst]:
    """All lost frames of each stretch, gathered; one that is alone is a burst of one."""
    return [
        Burst(k, a, int(some[0]), int(some[-1]), len(some), len(pieces[k].setpoints[a][0]))
        for k, one in enumerate(lost)
        for a, numbers in one.items()
        for some in np.split(numbers, np.flatnonzero(np.diff(numbers) > GATHER) + 1)
        if len(some)
    ]


def replaced(lost: Sequence[Lost], runs: Sequence[tuple[Burst, NDArray[np.int64]]]) -> list[Lost]:
    """`lost`, with those frames in place of each burst's."""
    out = [dict(one) for one in lost]
    for b, frames in runs:
        old = out[b.stretch][b.actuator]
        kept = old[(old < b.first) | (old > b.last)]
        out[b.stretch][b.actuator] = np.union1d(kept, frames)
    return out


def count(lost: Sequence[Lost]) -> int:
    """All of them."""
    return sum(len(k) for one in lost for k in one.values())


def at_once(pieces: Sequence[Stretch], lost: Sequence[Lost], cycle_s: float) -> float:
    """Share of the lost frames in whose cycle another drive's was lost as well."""
    half = 0.5 * cycle_s
    shared, total = 0, 0
    for piece, one in zip(pieces, lost, strict=True):
        at = {a: piece.setpoints[a][0][k] for a, k in one.items()}
        for a, own in at.items():
            others = np.sort(np.concatenate([np.empty(0), *(t for b, t in at.items() if b != a)]))
            early, late = (np.searchsorted(others, own + edge) for edge in (-half, half))
            shared += int(np.sum(late > early))
            total += len(own)
    return shared / max(total, 1)


def without(piece: Stretch, lost: Lost) -> Stretch:
    """`piece` without the setpoints that were lost."""
    told = {}
    for a, (t, v) in piece.setpoints.items():
        keep = np.ones(len(t), dtype=bool)
        keep[lost.get(a, np.empty(0, dtype=np.int64))] = False
        keep[0] = True
        told[a] = (t[keep], v[keep])
    return replace(piece, setpoints=told)
