"""Where in its operation a rig was at each sample: five independent partitions of the record.

speed      velocity_reversal, standstill, low_speed, high_speed
position   low, middle and high third of the range travelled
direction  forward, backward
load       light and heavy half of the actuator's force
time       first, second and last third of the stretch (warming up, slipping, drifting)

All come from the twin's own motion, so that the sensors' noise moves no sample from one region to another.
Regions of an actuator's signals are those of that actuator; of the IMU those of the axis where there is
one, otherwise the fastest actuator's speed and time alone.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hil.gap.record.problem import Problem, Series

Array = NDArray[np.float64]
Codes = NDArray[np.int64]

DIMENSIONS: Final[dict[str, tuple[str, ...]]] = {
    "speed": ("velocity_reversal", "standstill", "low_speed", "high_speed"),
    "position": ("position_low", "position_middle", "position_high"),
    "direction": ("backward", "forward"),
    "load": ("light_load", "heavy_load"),
    "time": ("first_third", "second_third", "last_third"),
}
"""Regions of each partition; code -1 stands for none of them."""

STILL: Final = 0.02
"""Share of the fast speed (its 95 % quantile) below which an actuator stands."""
SLOW: Final = 0.4
"""Share of the fast speed that divides low from high speed."""
NEAR_S: Final = 0.15
NEAR: Final = 0.15
"""A sample belongs to a reversal within NEAR_S of it, while slower than this share of the fast speed."""


def region_codes(problem: Problem, motion: Sequence[Mapping[str, Array]]) -> list[dict[str, Codes]]:
    """For each series, by dimension, the region of each of its samples (count,)."""
    fast = fast_speeds(problem, motion)
    return [_codes(problem, x, motion[x.stretch], fast) for x in problem.series]


def fast_speeds(problem: Problem, motion: Sequence[Mapping[str, Array]]) -> dict[str, float]:
    """By actuator the 95 % quantile of its speed over all stretches, m/s or rad/s."""
    return {
        a: float(np.quantile(np.concatenate([np.abs(m[f"{a}.velocity"]) for m in motion]), 0.95))
        for a in problem.rig.actuator_names
    }


def _codes(
    problem: Problem, x: Series, motion: Mapping[str, Array], fast: Mapping[str, float]
) -> dict[str, Codes]:
    t = problem.t_s[x.part]
    names = problem.rig.actuator_names
    own = x.actuator if x.actuator != "imu" else (names[0] if len(names) == 1 else None)
    time = np.minimum((3.0 * (t - t[0]) / max(t[-1] - t[0], 1e-9)).astype(np.int64), 2)
    if own is None:
        speeds = [np.abs(motion[f"{a}.velocity"]) / max(fast[a], 1e-9) for a in names]
        return {
            "speed": _pick(motion["t"], _general_speed(np.max(speeds, axis=0)), t),
            "time": time,
        }
    velocity = motion[f"{own}.velocity"]
    speed = velocity / max(fast[own], 1e-9)
    codes = {
        "speed": _speed(motion["t"], speed),
        "position": _thirds(motion[f"{own}.position"]),
        "direction": np.where(np.abs(speed) < STILL, -1, (speed > 0.0).astype(np.int64)),
        "load": _load(motion[f"{own}.force"]),
    }
    return {**{d: _pick(motion["t"], c, t) for d, c in codes.items()}, "time": time}


def _pick(grid: Array, codes: Codes, t: Array) -> Codes:
    """Codes at the grid's row nearest to each instant."""
    step = grid[1] - grid[0]
    k = np.clip(np.round((t - grid[0]) / step).astype(np.int64), 0, len(grid) - 1)
    return np.asarray(codes[k])


def _general_speed(speed: Array) -> Codes:
    return np.asarray(np.where(speed < STILL, 1, np.where(speed < SLOW, 2, 3)))


def _speed(t: Array, speed: Array) -> Codes:
    """The four regions of `speed` in shares of the fast speed; a reversal wins over standstill."""
    codes = _general_speed(np.abs(speed))
    moving = np.flatnonzero(np.abs(speed) >= STILL)
    turns = np.flatnonzero(np.sign(speed[moving[1:]]) != np.sign(speed[moving[:-1]]))
    for k in turns:
        before, after = t[moving[k]], t[moving[k + 1]]
        # after a rest it is the break-away that matters, and where the rest began
        for at in (before, after) if after - before > 2.0 * NEAR_S else (0.5 * (before + after),):
            near = (np.abs(t - at) <= NEAR_S) & (np.abs(speed) < NEAR)
            codes[near] = 0
    return codes


def _thirds(position: Array) -> Codes:
    low, high = float(position.min()), float(position.max())
    if high - low < 1e-6:
        return np.full(len(position), -1, dtype=np.int64)
    return np.minimum((3.0 * (position - low) / (high - low)).astype(np.int64), 2)


def _load(force: Array) -> Codes:
    return np.asarray((np.abs(force) > np.median(np.abs(force))).astype(np.int64))
