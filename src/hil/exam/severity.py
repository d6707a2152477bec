"""How large an effect must be so that it shows at so many times the floor: solved on the world itself.

Severity: the effect's own trace (root mean square of the world with it minus the world without, all chance
the same, nothing refitted) over the floor, on the signal that it touches most. The floor of a signal is
what two records of the same motion, sent at the same instants, differ by, over the square root of two.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from hil.config import Effect, RigFile
from hil.control.trajectory import CueTrajectory
from hil.exam.menu import Recipe
from hil.exam.world import Outside, Scatter, build_world
from hil.exam.world.play import Played, WorldError, play

Array = NDArray[np.float64]

NEAR: Final = math.log(1.12)
TRIES: Final = 12
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
        world = build_world(rig, scatter)
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
        world = build_world(self.rig, self.scatter, effects, outside)
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
            t, wanted = got.wanted[a.name]
            signal = f"{a.name}.position"
            stray = got.clean[signal] - np.interp(got.stamps[signal] - 0.02, t, wanted)
            if np.max(np.abs(stray)) > FOLLOWS * (a.stroke[1] - a.stroke[0]):
                raise WorldError(f"{self.rig.name}: {a.name} strays from its setpoints")


def effect_of(recipe: Recipe, size: float) -> tuple[tuple[Effect, ...], tuple[Outside, ...]]:
    """The recipe at a size, as effect or as outside effect."""
    parameters = {k: float(f"{v:.6g}") for k, v in recipe.parameters(size).items()}
    if recipe.is_outside:
        return (), (Outside(recipe.effect, recipe.location, parameters),)
    line = Effect(effect=recipe.effect, location=recipe.location, parameters=parameters)
    return (line,), ()


class Traced(Protocol):
    """Whatever can say how large effects show: `Bench`, or a ride's."""

    def trace(
        self, effects: tuple[Effect, ...], outside: tuple[Outside, ...] = ()
    ) -> dict[str, float]:
        """By signal, the trace over the floor; WorldError where the world cannot play it."""


@dataclass(frozen=True, slots=True)
class Solved:
    """A size, the traces that it has by signal, and the largest of them."""

    size: float
    traces: dict[str, float]
    reached: float


def solve_size(bench: Traced, recipe: Recipe, severity: float, lift: float = 1.2) -> Solved | None:
    """The size at which `recipe` has this severity; None where no sane size has it.

    Where that would lie within what a calibration sets right, the size is `lift` times the smallest that does
    not, and the severity higher than asked. Secants in the logarithms, halving where one side is known.
    """
    size = recipe.guess
    below: tuple[float, float] | None = None
    above: tuple[float, float] | None = None
    for _ in range(TRIES):
        try:
            traces = bench.trace(*effect_of(recipe, size))
            reached = max(traces.values())
        except WorldError:
            reached = math.inf
        if 0.0 < reached < math.inf and abs(math.log(reached / severity)) < NEAR:
            return _no_smaller(bench, recipe, Solved(size, traces, reached), lift)
        if reached < severity:
            below = (size, reached)
        else:
            above = (size, reached)
        if above is not None and above[0] <= recipe.smallest:
            return _no_smaller(bench, recipe, Solved(size, {}, 0.0), lift)
        if below is not None and below[0] >= recipe.largest:
            return None
        if below is not None and above is not None:
            size = _between(below, above, severity)
            continue
        factor = 0.3 if reached == math.inf else severity / max(reached, 0.25 * severity)
        size = min(size * max(factor, 0.05), recipe.largest)
    return None


def _between(below: tuple[float, float], above: tuple[float, float], severity: float) -> float:
    """A size between one that shows too little and one that shows too much."""
    x0, x1 = math.log(below[0]), math.log(above[0])
    share = 0.5
    if below[1] > 0.0 and above[1] < math.inf:
        share = math.log(severity / below[1]) / math.log(above[1] / below[1])
    return math.exp(x0 + min(max(share, 0.15), 0.85) * (x1 - x0))


def _no_smaller(bench: Traced, recipe: Recipe, found: Solved, lift: float) -> Solved | None:
    """`found`, or the smallest size that is no matter of calibration."""
    if found.size >= recipe.smallest and found.traces:
        return found
    size = min(lift * recipe.smallest, recipe.largest)
    try:
        traces = bench.trace(*effect_of(recipe, size))
    except WorldError:
        return None
    return Solved(size, traces, max(traces.values()))


def _strict(t: Array) -> Array:
    """Stamps that rise by a nanosecond at least."""
    return np.asarray(np.maximum.accumulate(t) + 1e-9 * np.arange(len(t)))
