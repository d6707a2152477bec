"""What a ride may have that no catalogue names: on the road, in the bicycle, in its sensors.

Each takes a `size`; all other numbers are drawn. `record` asks for them by kind.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np

from hil.exam.menu import Recipe

Rng = np.random.Generator
Line = tuple[str, float, float]
"""Name of the parameter that the size is, first guess, largest."""

KINDS: Final[dict[str, tuple[Line, Callable[[Rng], dict[str, float]]]]] = {
    # lean torque by gusts, N m
    "side_wind": (("torque", 8.0, 60.0), lambda r: {"s": float(r.uniform(0.6, 1.8))}),
    # the road goes up and down: slope, over a length
    "hills": (("slope", 0.01, 0.12), lambda r: {"length": float(r.uniform(12.0, 40.0))}),
    # tyres run askew under side load: rad of steer for each m/s2
    "side_slip": (("compliance", 0.003, 0.05), lambda r: {}),
    # the headset is loose: play between encoder and fork, rad
    "loose_headset": (("play", 0.01, 0.12), lambda r: {}),
    # the inclinometer feels the turn as lean: share of lateral acceleration over g
    "felt_turns": (("share", 0.05, 0.6), lambda r: {}),
    # the IMU's bracket bends under its load: rad for each m/s2, Hz of its own
    "soft_bracket": (
        ("compliance", 0.01, 0.2),
        lambda r: {"hz": float(r.uniform(2.0, 4.0)), "damping": float(r.uniform(0.1, 0.3))},
    ),
    # the gyroscope warms up: rad/s at the end
    "warm_gyro": (("drift", 0.01, 0.3), lambda r: {"axis": float(r.integers(3))}),
    # the gyroscope feels acceleration: rad/s for each m/s2
    "g_sensitive_gyro": (("gain", 0.005, 0.2), lambda r: {"axis": float(r.integers(3))}),
    # the wheel's encoder misses counts when it turns fast: share, above rad/s
    "missed_counts": (("share", 0.03, 0.5), lambda r: {"above": float(r.uniform(10.5, 12.5))}),
}
RIDE_OUTSIDE: Final = tuple(KINDS)


def draw_outside(kind: str, rng: Rng) -> Recipe:
    """An effect from outside the catalogue with a size left open."""
    (name, guess, largest), numbers = KINDS[kind]
    drawn = numbers(rng)
    return Recipe(
        kind, "bicycle", lambda s: {name: s, **drawn}, guess, largest, is_outside=True
    )  # fmt: skip
