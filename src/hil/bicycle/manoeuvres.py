"""What a rider can be asked to ride: a path with speeds, and the sentence that says it to a person."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from hil.bicycle.path import Path, eight, slalom, surges, u_turns
from hil.bicycle.simulated import SimulatedRide, simulate_ride
from hil.config import BicycleFile
from hil.errors import ConfigError


@dataclass(frozen=True, slots=True)
class Manoeuvre:
    """A way to ride."""

    name: str
    instruction: str
    """For the rider."""
    path: Callable[[], Path]
    cruise: float
    """m/s on straights."""
    turning: float
    """m/s in turns."""
    vigour: float = 1.0
    """Of pulling away (1 m/s²) and braking (1.6 m/s²), as a factor."""

    def ride(self, rig: BicycleFile, seed: int = 0, *, road_m: float = 0.0) -> SimulatedRide:
        """A simulated ride of `rig`, with its file's effects; KinematicsError where it falls."""
        return simulate_ride(
            rig, self.path(), seed, cruise=self.cruise, turning=self.turning, road_m=road_m,
            vigour=self.vigour,
        )  # fmt: skip


MANOEUVRES: Final = (
    Manoeuvre(
        "u-turns",
        "ride 50 m straight at 5 m/s, turn round to the left on 6 m of radius at 3.6 m/s, ride back, turn "
        "round again and stop where you began",
        u_turns,
        5.0,
        3.6,
    ),
    Manoeuvre(
        "slalom",
        "ride 100 m round marks 9 m apart, at 3.6 m/s between them",
        slalom,
        5.0,
        3.6,
    ),
    Manoeuvre(
        "wide-slalom",
        "ride 110 m at 6 m/s round marks 14 m apart without slowing down",
        lambda: slalom(110.0, 28.0, 18.0),
        6.0,
        6.0,
    ),
    Manoeuvre(
        "surges",
        "ride 90 m straight, every 22 m up to 5 m/s and down to 2.5 m/s, gently",
        surges,
        5.0,
        3.6,
    ),
    Manoeuvre(
        "hard-surges",
        "ride 90 m straight, every 15 m pull hard up to 5 m/s and brake hard down to 2.3 m/s",
        lambda: surges(90.0, 15.0),
        5.0,
        3.6,
        2.0,
    ),
    Manoeuvre(
        "eight",
        "ride a circle of 6 m radius to the left and one to the right at 3.6 m/s",
        eight,
        4.5,
        3.6,
    ),
    Manoeuvre(
        "wide-eight",
        "ride a circle of 12 m radius to the left and one to the right at 5 m/s",
        lambda: eight(12.0, 6.0),
        5.5,
        5.0,
    ),
    Manoeuvre(
        "straight",
        "ride 100 m straight at a steady 5 m/s, hands quiet; stop gently",
        lambda: surges(100.0, 1000.0),
        5.0,
        3.6,
    ),
)  # fmt: skip
"""What `hil bicycle simulate` rides and `hil gap next` chooses from."""


def manoeuvre(name: str) -> Manoeuvre:
    """By name; ConfigError lists the others."""
    for m in MANOEUVRES:
        if m.name == name:
            return m
    raise ConfigError(f"{name!r} is no manoeuvre: {', '.join(m.name for m in MANOEUVRES)}")
