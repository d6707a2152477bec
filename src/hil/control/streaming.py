"""A motion known beforehand as the sequence of cues that a client would send.

Each cue carries the pose of its own instant and a few of the next hundredths of a second, so that shaping
need not guess where the motion goes.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator

from hil.control.trajectory import CueTrajectory
from hil.signals import Cue, TimedPose

Array = NDArray[np.float64]
Motion = Callable[[Array], Array]
"""Poses (k, coordinates) at times (k,), s; rad or m."""

RATE_HZ: Final = 50.0
AHEAD_S: Final = tuple(round(0.01 * k, 2) for k in range(11))
"""Instants of a cue's poses after its own, s: shaping looks 50 ms ahead, and a cue may be late. Every
10 ms, so that what is read between them is the motion up to some 10 Hz."""


def motion_of(trajectory: CueTrajectory) -> Motion:
    """`trajectory` at any time: its own poses between its rows, its first and last outside."""
    curve = PchipInterpolator(trajectory.t_s, trajectory.poses, axis=0)
    first_s, last_s = float(trajectory.t_s[0]), float(trajectory.t_s[-1])
    return lambda t_s: np.asarray(curve(np.clip(t_s, first_s, last_s)))


def cues(
    motion: Motion,
    start_s: float,
    end_s: float,
    client: str,
    rate_hz: float = RATE_HZ,
    ahead_s: Sequence[float] = AHEAD_S,
) -> Iterator[Cue]:
    """Cues from `start_s` to `end_s` of `motion`; their own times count from 0."""
    offsets_s = np.asarray(ahead_s)
    for k in range(int((end_s - start_s) * rate_hz + 1.0e-9) + 1):
        at_s = k / rate_hz
        poses = motion(start_s + at_s + offsets_s)
        timed = tuple(
            TimedPose(dt_s, tuple(pose)) for dt_s, pose in zip(ahead_s, poses.tolist(), strict=True)
        )
        yield Cue(client, k, at_s, at_s, timed)
