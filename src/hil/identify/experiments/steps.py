"""Steps of coordinates or of single actuators, as quick and as smooth as the rig's limits allow."""

from __future__ import annotations

from math import ceil
from typing import Final

import numpy as np

from hil.config import RigFile
from hil.control.actuator_limits import SPEED_SHARE
from hil.control.trajectory import CueTrajectory
from hil.errors import ConfigError
from hil.identify.experiments.description import Segment
from hil.identify.experiments.plans import Custom, Step
from hil.identify.experiments.shapes import REST_S, Grid, Shape, chosen, each, preferred
from hil.identify.experiments.signals import Array, smooth_step
from hil.rigs import Manipulator

PEAKS: Final = (35.0 / 16.0, 84.0 / (5.0 * np.sqrt(5.0)), 52.5)
"""Largest speed, acceleration and jerk of `smooth_step` in a unit of time."""

AT_REST: Final = 0.02
"""Share of a coordinate's speed limit at which a motion from a file may begin or end."""


def step_shape(plan: Step, rig: RigFile, manipulator: Manipulator) -> Shape:
    """Up, hold, down, hold, `count` times. Takes as long as `share` of the limits asks for."""
    if plan.actuators:
        return _actuator_steps(plan, rig, manipulator)
    moving = chosen(plan, rig, [preferred(rig)])
    heights = each(plan.amplitude or (plan.size,), moving)
    top = np.zeros(manipulator.n)
    top[[rig.coordinates.index(c) for c in moving]] = heights
    profile, segments = _profile(plan, rig, manipulator, top)
    return Shape(moving, heights, lambda s: np.outer(profile, s * top), segments)


def custom_shape(plan: Custom, rig: RigFile, motion: CueTrajectory) -> Shape:
    """The motion of a file on the rig's own grid, coordinates that it leaves out neutral.

    ConfigError for a coordinate that the rig has not.
    """
    unknown = [c for c in motion.coordinates if c not in rig.coordinates]
    if unknown:
        raise ConfigError(
            f"{plan.file}: column {unknown[0]!r} is no coordinate of {rig.name}; "
            f"it has {', '.join(rig.coordinates)}"
        )
    grid = Grid(rig)
    even = motion.resampled(grid.rate_hz)
    if plan.cutoff:
        even = even.low_passed(plan.cutoff)
    _need_rest(plan, rig, even)
    rows = np.zeros((len(even.t_s), len(rig.coordinates)))
    rows[:, [rig.coordinates.index(c) for c in motion.coordinates]] = even.poses
    full = np.concatenate([grid.rest(rows[:1]), rows, grid.rest(rows)])
    begin_s = grid.seconds(REST_S)
    segment = Segment(name="custom", start_s=begin_s, end_s=begin_s + even.duration_s)
    peaks = np.max(np.abs(even.poses), axis=0)
    return Shape(motion.coordinates, tuple(peaks.tolist()), lambda s: s * full, (segment,))


def _need_rest(plan: Custom, rig: RigFile, motion: CueTrajectory) -> None:
    """ConfigError where the motion of a file begins or ends at a speed."""
    for row, what in ((0, "begins"), (-1, "ends")):
        step = motion.poses[row] - motion.poses[1 if row == 0 else -2]
        for name, speed in zip(motion.coordinates, np.abs(step) / motion.step_s, strict=True):
            allowed = AT_REST * rig.cue_limits()[0][rig.coordinates.index(name)]
            if speed > allowed:
                raise ConfigError(
                    f"{plan.file}: {what} with {name} at {speed:.3g}/s; a motion begins and ends at rest "
                    f"(below {allowed:.3g}/s here): fade it in and out"
                )


def _actuator_steps(plan: Step, rig: RigFile, manipulator: Manipulator) -> Shape:
    if plan.coordinates:
        raise ConfigError("step: give coordinates or actuators, not both")
    for name in plan.actuators:
        if name not in rig.actuator_names:
            raise ConfigError(
                f"{rig.name} has no actuator {name!r}; it has {', '.join(rig.actuator_names)}"
            )
    heights = each(plan.amplitude or (plan.size,), plan.actuators)
    rho = manipulator.inverse(manipulator.neutral)
    by = np.zeros(manipulator.n)
    by[[rig.actuator_names.index(a) for a in plan.actuators]] = heights
    profile, segments = _profile(plan, rig, manipulator, manipulator.forward(rho + by))

    def poses(scale: float) -> Array:
        levels, where = np.unique(profile, return_inverse=True)
        found = np.empty((len(levels), manipulator.n))
        guess = manipulator.neutral
        for k, level in enumerate(levels):
            found[k] = guess = manipulator.forward(rho + scale * level * by, guess)
        return found[where]

    return Shape(plan.actuators, heights, poses, segments)


def _profile(
    plan: Step, rig: RigFile, manipulator: Manipulator, top: Array
) -> tuple[Array, tuple[Segment, ...]]:
    """Rows between 0 and 1, and from each onset to the next."""
    grid = Grid(rig)
    rise_s = _rise_s(plan, rig, manipulator, top)
    grid.seconds(2.0 * plan.count * (rise_s + plan.hold_s))
    rise_s = ceil(rise_s / grid.tick_s) * grid.tick_s
    rise = round(rise_s * grid.rate_hz)
    up = smooth_step(np.arange(1, rise + 1) / rise)
    hold = round(grid.seconds(plan.hold_s) * grid.rate_hz)
    rest = np.zeros(round(grid.seconds(REST_S) * grid.rate_hz))
    one = np.concatenate([up, np.ones(hold), 1.0 - up, np.zeros(hold)])
    half_s = 0.5 * len(one) / grid.rate_hz
    begin_s = (len(rest) - 1) / grid.rate_hz
    segments = tuple(
        Segment(
            name=f"{'down' if k % 2 else 'up'} {k // 2 + 1}",
            start_s=round(begin_s + k * half_s, 9),
            end_s=round(begin_s + (k + 1) * half_s, 9),
        )
        for k in range(2 * plan.count)
    )
    return np.concatenate([rest, np.tile(one, plan.count), rest]), segments


def _rise_s(plan: Step, rig: RigFile, manipulator: Manipulator, top: Array) -> float:
    """Time in which `share` of each limit of coordinates and actuators is used, s."""
    travel = np.abs(manipulator.inverse(top) - manipulator.inverse(manipulator.neutral))
    velocity, acceleration, jerk = (np.asarray(x) for x in rig.cue_limits())
    speed = SPEED_SHARE * np.array([a.velocity_max for a in rig.actuators])
    force = np.array([a.acceleration_max for a in rig.actuators])
    height = np.abs(top)
    demands = (
        np.max([np.max(height / velocity), np.max(travel / speed)]),
        np.max([np.max(height / acceleration), np.max(travel / force)]),
        np.max(height / jerk),
    )
    return float(
        max(
            (peak * d / plan.share) ** (1.0 / k)
            for k, (peak, d) in enumerate(zip(PEAKS, demands, strict=True), 1)
        )
    )
