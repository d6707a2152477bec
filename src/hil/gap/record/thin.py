"""Records of fast buses: every so many answers of a drive.

Samples are instants at which twin and record are compared, and the twin answers any instant; nothing is
filtered, so nothing folds down. Beyond some samples the small ways in which a twin is wrong count and not
noise, but each of them costs time and memory in every replay.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

from hil.config import RigFile
from hil.identify.replay import Series, Stretch

ENOUGH_HZ: Final = 1200.0
"""Answers a second of all drives together that are judged, or a little more: twice those of a hexapod on a
slotted channel."""


def thinned(rig: RigFile, pieces: Sequence[Stretch]) -> tuple[list[Stretch], int]:
    """`pieces` with every n-th answer of each signal of a drive, and that n; all of them where n is 1.

    One n for all, so that they keep their places between the setpoints of a regular bus.
    """
    drives = tuple(f"{a}." for a in rig.actuator_names)

    def rate_hz(piece: Stretch) -> float:
        counts = [len(t) for s, (t, _) in piece.samples.items() if s.startswith(drives)]
        start, end = piece.span_s
        return sum(counts) / max(end - start, 1e-9)

    every = max(int(max(map(rate_hz, pieces), default=0.0) / ENOUGH_HZ), 1)

    def thin(signal: str, series: Series) -> Series:
        t, values = series
        return (t[::every], values[::every]) if signal.startswith(drives) else series

    out = [replace(p, samples={s: thin(s, x) for s, x in p.samples.items()}) for p in pieces]
    return out, every
