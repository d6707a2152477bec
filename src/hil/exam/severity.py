"""How large an effect must be so that it shows at so many times the floor: solved on the world itself.

Severity: the effect's own trace (root mean square of the world with it minus the world without, all chance
the same, nothing refitted) over the floor, on the signal that it touches most. The floor of a signal is
what two records of the same motion, sent at the same instants, differ by, over the square root of two.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from hil.config import Effect, RigFile
from hil.control.trajectory import CueTrajectory
from hil.exam.menu import Recipe
from hil.exam.world.body import Outside, Scatter, World
from hil.exam.world.play import Played, WorldError, play

Array = NDArray[np.float64]

NEAR: Final = math.log(1.12)
TRIES: Final = 9
LOOK_S: Final = 18.0
FOLLOWS: Final = 0.12
"""A rig that strays further from its setpoints, in strokes, would have been stopped."""


@dataclass(frozen=True, slots=True)
class Bench:
    """A motion on a healthy rig, to measure effects against."""

    rig: RigFile
    scatter: Scatter
    trajectory: CueTrajectory
    seeds: tuple[int, int]
    with_imu: bool
    healthy: Played
    floor: dict[str, float]

    @classmethod
    def of(
        cls,
        rig: RigFile,
        scatter: Scatter,
        trajectory: CueTrajectory,
        seeds: tuple[int, int],
        with_imu: bool,
    ) -> Bench:
        """Two healthy records of the motion's first LOOK_S, and the floor between them."""
        seen = trajectory.t_s <= LOOK_S
        trajectory = CueTrajectory(
            trajectory.coordinates, trajectory.t_s[seen], trajectory.poses[seen]
        )
        world = World.of(rig, scatter)
        first = play(world, trajectory, seen=seeds[0], hidden=seeds[1], with_imu=with_imu)
        second = play(world, trajectory, seen=seeds[0], hidden=seeds[1] + 1, with_imu=with_imu)
        floor = {}
        for s, t in first.stamps.items():
            again = CubicSpline(_strict(second.stamps[s]), second.clean[s])(t) - first.clean[s]
            noise = np.concatenate(
                [first.values[s] - first.clean[s], second.values[s] - second.clean[s]]
            )
            floor[s] = float(np.sqrt(np.mean(noise**2) + 0.5 * np.mean(again**2)))
        return cls(rig, scatter, trajectory, seeds, with_imu, first, floor)

    def trace(
        self, effects: tuple[Effect, ...], outside: tuple[Outside, ...] = ()
    ) -> dict[str, float]:
        """By signal, the trace over the floor; WorldError where the rig would not have run on."""
        world = World.of(self.rig, self.scatter, effects, outside)
        got = play(
            world, self.trajectory, seen=self.seeds[0], hidden=self.seeds[1], with_imu=self.with_imu
        )
        self._check_follows(got)
        out = {}
        for s, t in self.healthy.stamps.items():
            value = got.clean[s]
            if len(value) != len(t) or np.any(got.stamps[s] != t):
                value = CubicSpline(_strict(got.stamps[s]), value)(t)
            out[s] = float(np.sqrt(np.mean((value - self.healthy.clean[s]) ** 2))) / self.floor[s]
        return out

    def _check_follows(self, got: Played) -> None:
        for a in self.rig.actuators:
            t, told = got.setpoints[f"{a.name}.setpoint"]
            signal = f"{a.name}.position"
            stray = got.clean[signal] - np.interp(got.stamps[signal] - 0.02, t, told)
            if np.max(np.abs(stray)) > FOLLOWS * (a.stroke[1] - a.stroke[0]):
                raise WorldError(f"{self.rig.name}: {a.name} strays from its setpoints")


def effect_of(recipe: Recipe, size: float) -> tuple[tuple[Effect, ...], tuple[Outside, ...]]:
    """The recipe at a size, as effect or as outside effect."""
    parameters = {k: float(f"{v:.6g}") for k, v in recipe.parameters(size).items()}
    if recipe.is_outside:
        return (), (Outside(recipe.effect, recipe.location, parameters),)
    line = Effect(effect=recipe.effect, location=recipe.location, parameters=parameters)
    return (line,), ()


def solve_size(
    bench: Bench, recipe: Recipe, severity: float
) -> tuple[float, dict[str, float]] | None:
    """Size at which `recipe` has this severity, and its traces; None where no sane size has it."""
    size, slope = recipe.guess, 1.0
    last: tuple[float, float] | None = None
    for _ in range(TRIES):
        try:
            traces = bench.trace(*effect_of(recipe, size))
        except WorldError:
            if last is None:
                size *= 0.2
                continue
            return None
        reached = max(traces.values())
        if reached > 0.0 and abs(math.log(reached / severity)) < NEAR:
            return (size, traces) if size >= recipe.smallest else None
        if reached > severity and size <= recipe.smallest:
            return None
        if last is not None and reached > 0.0 and last[1] > 0.0 and size != last[0]:
            found = math.log(reached / last[1]) / math.log(size / last[0])
            slope = min(max(found, 0.35), 3.0)
        last = (size, reached)
        factor = 2.0 if reached <= 0.0 else (severity / reached) ** (1.0 / slope)
        new = min(size * min(max(factor, 0.02), 4.0), recipe.largest)
        if new == size:
            return None
        size = new
    return None


def _strict(t: Array) -> Array:
    """Stamps that rise by a nanosecond at least."""
    return np.asarray(np.maximum.accumulate(t) + 1e-9 * np.arange(len(t)))
