"""From plan and rig to a motion that the rig can make and its shaping lets through unchanged."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from hil import __version__
from hil.config import RigFile
from hil.control.trajectory import CueTrajectory, check
from hil.errors import ConfigError, LimitViolation
from hil.identify.experiments.description import Description
from hil.identify.experiments.limits import Use, fitted_scale, trajectory_of, uses
from hil.identify.experiments.multisines import multisine_shape
from hil.identify.experiments.plans import Circle, Custom, Multisine, Plan, Step
from hil.identify.experiments.shaped import Shaped, shaped
from hil.identify.experiments.shapes import Grid, Shape, circle_shape, tone_shape
from hil.identify.experiments.steps import custom_shape, step_shape
from hil.rigs import Manipulator, build_rig

SHRINK: Final = 0.96
TRIES: Final = 12
"""Sizes tried, each a little smaller, where shaping needs more room than the limits' own reserve."""


@dataclass(frozen=True, slots=True)
class Design:
    """A motion to play, with what there is to say about it."""

    description: Description
    trajectory: CueTrajectory
    uses: tuple[Use, ...]
    shaped: Shaped


def design(plan: Plan, rig: RigFile, custom: CueTrajectory | None = None) -> Design:
    """The experiment of `plan` on `rig`; `custom` is the motion of a custom plan's file.

    ConfigError where the plan does not fit the rig (names option and bound), LimitViolation where no
    size of it keeps the rig's limits. Takes about a second for a minute of motion: all of it is shaped.
    """
    manipulator = build_rig(rig)
    if rig.cue.gain < 1.0:
        raise ConfigError(
            f"{rig.name}: cue.gain is {rig.cue.gain:g}: every motion would be made smaller than designed; "
            "set it to 1 for experiments"
        )
    shape = _shape(plan, rig, manipulator, custom)
    share = 1.0 if isinstance(plan, Custom) else plan.share
    scale, reason = fitted_scale(shape, rig, manipulator, share)
    asked = share if shape.is_relative else 1.0
    for _ in range(TRIES):
        trajectory = trajectory_of(shape, rig, scale)
        broken = check(trajectory, rig, manipulator)
        result = shaped(trajectory, rig, manipulator) if not broken else None
        if result is not None and result.is_as_designed:
            return Design(
                _described(plan, rig, shape, scale, asked, reason, trajectory),
                trajectory,
                uses(trajectory, rig, manipulator),
                result,
            )
        reason = str(broken[0] if broken else result)
        scale *= SHRINK
    raise LimitViolation(
        f"{rig.name}: this {plan.kind} cannot be made as designed, at {scale / asked:.2f} of its size "
        f"still {reason}; lower its highest frequency or lengthen its fades"
    )


def _shape(
    plan: Plan, rig: RigFile, manipulator: Manipulator, custom: CueTrajectory | None
) -> Shape:
    match plan:
        case Step():
            return step_shape(plan, rig, manipulator)
        case Multisine():
            return multisine_shape(plan, rig)
        case Circle():
            return circle_shape(plan, rig)
        case Custom():
            if custom is None:
                raise ConfigError(f"custom: the motion of {plan.file} was not read")
            return custom_shape(plan, rig, custom)
        case _:
            return tone_shape(plan, rig)


def _described(
    plan: Plan,
    rig: RigFile,
    shape: Shape,
    scale: float,
    asked: float,
    reason: str,
    trajectory: CueTrajectory,
) -> Description:
    return Description(
        rig=rig.name,
        hil=__version__,
        plan=plan,
        coordinates=shape.moving,
        amplitude=tuple(scale * a for a in shape.amplitude),
        scale=scale / asked,
        scaled_because=reason,
        rate_hz=Grid(rig).rate_hz,
        duration_s=trajectory.duration_s,
        period_s=shape.period_s,
        lines=shape.lines,
        detection=shape.detection,
        segments=shape.segments,
    )
