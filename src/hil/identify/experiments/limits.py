"""How much of each limit a motion uses, and the largest size at which it keeps them all."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from hil.config import RigFile
from hil.control.actuator_limits import SPEED_SHARE, ActuatorLimits
from hil.control.trajectory import CueTrajectory
from hil.errors import KinematicsError, LimitViolation
from hil.identify.experiments.shapes import Grid, Shape
from hil.identify.experiments.signals import Array
from hil.rigs import Manipulator

RESERVE: Final = 0.95
"""Share of speed, acceleration and jerk limits that a design may use: shaping needs a little room."""
MOST_ROWS: Final = 4000
"""About so many rows are looked at for actuators; whoever needs each row asks trajectory.check."""
ROUNDING: Final = 1.0e-5
"""Share of workspace and strokes left, so that rounding does not carry a cue over them."""
SMALLEST: Final = 1.0e-3
"""A motion that had to shrink further than to this part would measure nothing."""
SMALLEST_ASKED: Final = 0.05
"""One whose size was given is then not what was meant: degrees for rad are 57 times too much, mm 1000."""
POSITIONS: Final = ("workspace", "stroke")


@dataclass(frozen=True, slots=True)
class Use:
    """The most that a motion uses of one limit: `value` of `bound`, SI."""

    rule: str
    """workspace, velocity, acceleration, jerk of a coordinate; stroke, speed, acceleration of an actuator."""
    name: str
    value: float
    bound: float

    @property
    def share(self) -> float:
        """1 = all of it."""
        return self.value / self.bound

    def __str__(self) -> str:
        return f"{self.rule} of {self.name}: {self.value:.4g} of {self.bound:.4g}"


def uses(trajectory: CueTrajectory, rig: RigFile, manipulator: Manipulator) -> tuple[Use, ...]:
    """Every limit of coordinates and actuators with the most that the trajectory uses of it.

    Speeds count with what is still added while the acceleration is taken back at the jerk limit, as
    shaping counts them. KinematicsError where a pose does not close.
    """
    return (
        *_coordinate_uses(trajectory, rig, manipulator),
        *_actuator_uses(trajectory, rig, manipulator),
    )


def fitted_scale(
    shape: Shape, rig: RigFile, manipulator: Manipulator, share: float
) -> tuple[float, str]:
    """Scale at which the shape keeps all limits, and what held it down ("" if nothing did).

    A shape of relative size is scaled to use `share` of the limit reached first; any other one is
    only scaled down. LimitViolation where nothing worth measuring is left.
    """
    scale, reason = (share, "") if shape.is_relative else (1.0, "")
    for _ in range(60):
        try:
            worst, allowed = _tightest(shape, rig, manipulator, scale, share)
        except KinematicsError as error:
            scale, reason = 0.5 * scale, str(error)
            continue
        if worst.share <= allowed * (1.0 + 1.0e-9):
            if not shape.is_relative or worst.share > 0.98 * allowed:
                return scale, reason
        elif not shape.is_relative and worst.share > allowed + 2.0 * ROUNDING:
            reason = str(worst)
        scale *= allowed / worst.share * (1.0 - 1.0e-6)
        if scale < (SMALLEST * share if shape.is_relative else SMALLEST_ASKED):
            break
    raise LimitViolation(
        f"{rig.name}: the motion would have to shrink to {scale:.2g} of what was asked for: {reason}. Ask "
        "for less, or see whether it is in m and rad, and whether a file's motion jumps"
    )


def trajectory_of(shape: Shape, rig: RigFile, scale: float) -> CueTrajectory:
    """The shape at a scale; times from 0."""
    poses = shape.poses(scale)
    return CueTrajectory(rig.coordinates, np.arange(len(poses)) / Grid(rig).rate_hz, poses)


def _tightest(
    shape: Shape, rig: RigFile, manipulator: Manipulator, scale: float, share: float
) -> tuple[Use, float]:
    """The limit most exceeded or nearest, and the share of it that is allowed.

    Actuators are looked at only where the coordinates' own limits are kept: that costs a thousand times less.
    """

    def allowed(use: Use) -> float:
        if shape.is_relative:
            return share
        return 1.0 - ROUNDING if use.rule in POSITIONS else RESERVE

    trajectory = trajectory_of(shape, rig, scale)
    found = _coordinate_uses(trajectory, rig, manipulator)
    if all(use.share <= allowed(use) * (1.0 + 1.0e-6) for use in found):
        found += _actuator_uses(trajectory, rig, manipulator)
    worst = max(found, key=lambda use: use.share / allowed(use))
    return worst, allowed(worst)


def _derivatives(trajectory: CueTrajectory, rig: RigFile) -> tuple[Array, Array, Array, Array]:
    """Velocity, acceleration, jerk, and speed still added while the acceleration is taken back."""
    velocity, acceleration, jerk = trajectory.derivatives()
    still = acceleration**2 / (2.0 * np.asarray(rig.cue_limits()[2]))
    return velocity, acceleration, jerk, np.where(velocity * acceleration > 0.0, still, 0.0)


def _coordinate_uses(
    trajectory: CueTrajectory, rig: RigFile, manipulator: Manipulator
) -> list[Use]:
    velocity, acceleration, jerk, faster = _derivatives(trajectory, rig)
    v_max, a_max, j_max = (np.asarray(x) for x in rig.cue_limits())
    a_max = a_max * ActuatorLimits(rig, manipulator).acceleration_share(rig.limits, a_max)
    rules = (
        ("workspace", np.abs(trajectory.poses), np.asarray(rig.limits)),
        ("velocity", np.abs(velocity) + faster, v_max),
        ("acceleration", np.abs(acceleration), a_max),
        ("jerk", np.abs(jerk), j_max),
    )
    return [
        Use(rule, name, float(np.max(values[:, k])), float(bound[k]))
        for rule, values, bound in rules
        for k, name in enumerate(trajectory.coordinates)
    ]


def _actuator_uses(trajectory: CueTrajectory, rig: RigFile, manipulator: Manipulator) -> list[Use]:
    thin = max(1, len(trajectory.t_s) // MOST_ROWS)
    velocity, acceleration, _, faster = _derivatives(trajectory, rig)
    q = trajectory.poses[::thin]
    neutral = manipulator.inverse(manipulator.neutral)
    margin = rig.safety.stroke_margin
    rho, speed, strain = (np.empty_like(q) for _ in range(3))
    rows = zip(q, velocity[::thin], acceleration[::thin], faster[::thin], strict=True)
    for k, (pose, qd, qdd, more) in enumerate(rows):
        J = manipulator.jacobian(pose)
        rho[k] = manipulator.inverse(pose)
        speed[k] = np.abs(J @ qd) + np.abs(J) @ more
        strain[k] = np.abs(manipulator.accelerations(pose, qd, qdd))
    found = []
    for i, actuator in enumerate(rig.actuators):
        ends = (neutral[i] - actuator.stroke[0] - margin, actuator.stroke[1] - margin - neutral[i])
        reach = (float(np.max(neutral[i] - rho[:, i])), float(np.max(rho[:, i] - neutral[i])))
        side = 0 if reach[0] / ends[0] > reach[1] / ends[1] else 1
        fastest, quickest = float(np.max(speed[:, i])), float(np.max(strain[:, i]))
        found += [
            Use("stroke", actuator.name, reach[side], float(ends[side])),
            Use("speed", actuator.name, fastest, SPEED_SHARE * actuator.velocity_max),
            Use("acceleration", actuator.name, quickest, actuator.acceleration_max),
        ]
    return found
