"""One unmodelled effect of a size still to be found."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from benchmarks.third_lab.plant import Plant
from benchmarks.third_lab.sensing import Sensing
from hil.config import Actuator

World = tuple[Plant, Sensing]


@dataclass(frozen=True)
class Effect:
    """What `size` in [low, high] does to a world; `parameters` says it in the catalogue's units.

    `low` lies above what a careful commissioning leaves, `high` is what a rig might still run with.
    """

    name: str
    location: str
    low: float
    high: float
    apply: Callable[[float, World], World]
    parameters: Callable[[float], dict[str, float]]
    calibrates_away: bool = False
    """Whether a plain calibration on the same run would absorb it, so that a reference is needed."""


@dataclass(frozen=True)
class Setting:
    """What a maker of effects may know: the rig, its own luck, what the healthy runs reach."""

    ideal: Plant
    rng: np.random.Generator
    force: np.ndarray  # (n, 2) mean and largest |force| of the healthy runs, N
    speed: np.ndarray  # (n,) largest |speed|, m/s

    def actuator(self) -> str:
        """One at random."""
        return str(self.rng.choice(self.ideal.rig.actuator_names))

    def side(self) -> float:
        """-1 or 1."""
        return float(self.rng.choice([-1.0, 1.0]))

    def nominal(self, name: str) -> Actuator:
        """The rig file's table of actuator `name`."""
        return self.ideal.rig.actuators[self.ideal.index(name)]

    def direction(self) -> np.ndarray:
        """A random unit vector."""
        d = self.rng.standard_normal(3)
        return d / np.linalg.norm(d)


Maker = Callable[[Setting], Effect]


def on_plant(change: Callable[[float, Plant], Plant]) -> Callable[[float, World], World]:
    """An `apply` that leaves the sensors alone."""
    return lambda size, world: (change(size, world[0]), world[1])


def on_sensing(change: Callable[[float, Sensing], Sensing]) -> Callable[[float, World], World]:
    """An `apply` that leaves the plant alone, the very object."""
    return lambda size, world: (world[0], change(size, world[1]))
