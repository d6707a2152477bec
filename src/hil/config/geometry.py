"""Where the joints are: one table a kind of mechanism. Lengths in m, base frame, z up."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from hil.config.base import Positive, Settings, Vector3


class AxisGeometry(Settings):
    """One actuator that moves a load along a line, up and down, or about a horizontal axis."""

    kind: Literal["axis_1dof"] = Field(
        "axis_1dof", exclude=True, description="as the rig file's kind"
    )
    load: Literal["horizontal", "vertical", "pendulum"] = Field(
        "horizontal",
        description="horizontal: no gravity along the axis; vertical: gravity pulls towards minus; "
        "pendulum: the actuator turns the load (rad, N·m) about a horizontal axis, 0 hangs down",
    )


class MotorcycleGeometry(Settings):
    """The 3-DOF motorcycle-simulator platform: two front legs and a rear slide."""

    kind: Literal["motorcycle_3dof"] = Field(
        "motorcycle_3dof", exclude=True, description="as the rig file's kind"
    )
    L: Positive = Field(description="distance of the rear slide's line behind the base origin, m")
    h: Positive = Field(description="height of the rear slide's line above the base origin, m")
    l: Positive = Field(  # noqa: E741 - the field's own name
        description="HALF the distance between the front joints P1 and P2, m"
    )
    l3: Positive = Field(description="rear joint P3 behind the platform origin, m")
    h3: float = Field(
        0.0, description="rear joint P3 below the platform origin, m", ge=-2.0, le=2.0
    )


class StewartGeometry(Settings):
    """Six legs between base joints and platform (cabin) joints; any hexapod is six rows each."""

    kind: Literal["stewart_6dof"] = Field(
        "stewart_6dof", exclude=True, description="as the rig file's kind"
    )
    base: Annotated[tuple[Vector3, ...], Field(min_length=6, max_length=6)] = Field(
        description="base joints of leg1..leg6 in the base frame, m"
    )
    cabin: Annotated[tuple[Vector3, ...], Field(min_length=6, max_length=6)] = Field(
        description="platform joints of leg1..leg6 in the platform frame, m"
    )
    height: Positive = Field(description="height of the platform origin at the neutral pose, m")

    @model_validator(mode="after")
    def _joints_differ(self) -> StewartGeometry:
        for name, joints in (("base", self.base), ("cabin", self.cabin)):
            if len(set(joints)) < 3:
                raise ValueError(
                    f"{name}: fewer than three different joints cannot hold a platform"
                )
        return self


Geometry = Annotated[
    AxisGeometry | MotorcycleGeometry | StewartGeometry, Field(discriminator="kind")
]
