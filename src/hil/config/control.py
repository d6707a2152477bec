"""What the daemon asks for and how: control mode and gains, cue shaping, parking."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from hil.config.base import NonNegative, Positive, Settings

Mode = Literal["drive", "cascade", "computed_torque"]


class PlatformFilterSettings(Settings):
    """Low-pass filter and delay between the motion asked for and the controller: e^(-τs)/(1+s/2πf)²."""

    frequency: Annotated[float, Field(ge=0.5, le=200.0)] = Field(
        description="break frequency f of both poles, Hz"
    )
    delay: Annotated[float, Field(ge=0.0, le=0.5)] = Field(0.0, description="time delay τ, s")


class Control(Settings):
    """Control mode and gains of the loops that the daemon closes itself."""

    mode: Mode = Field(
        "drive",
        description="drive: position setpoints to the drive's own cascade; cascade: P/PI loops in the "
        "daemon, force setpoints; computed_torque: model-based force setpoints",
    )
    precontrol: bool = Field(
        False,
        description="mode drive: switch on the drives' velocity, acceleration and friction pre-control "
        "(velocity_ff, acceleration_ff, friction_ff = 1) at arming",
    )
    bandwidth: Positive = Field(
        30.0,
        description="computed_torque: pole of the position error; cascade: its speed loops cross over at "
        "1.5 times this, position gain is a third of it or less, rad/s",
    )
    damping: Annotated[float, Field(ge=0.3, le=2.0)] = Field(
        1.0, description="computed_torque: damping ratio of the error dynamics"
    )
    integral: NonNegative = Field(
        0.0,
        description="cascade: rate of the speed loop's integrator, 1/s; 0 = 0.7 of the position gain",
    )
    observer: Positive = Field(60.0, description="bandwidth of the state observer, rad/s")
    platform_filter: PlatformFilterSettings | None = Field(
        None, description="filter that the platform puts on every coordinate; none unless given"
    )


class CueLimits(Settings):
    """How cues are shaped before they move anything. One value a coordinate, in the rig's order."""

    velocity: tuple[Positive, ...] = Field(
        (), description="m/s or rad/s; empty: by kind of coordinate"
    )
    acceleration: tuple[Positive, ...] = Field((), description="m/s² or rad/s²")
    jerk: tuple[Positive, ...] = Field((), description="m/s³ or rad/s³")
    gain: Annotated[float, Field(ge=0.0, le=1.0)] = Field(
        1.0, description="master gain on every cue; lowers motion, never raises it"
    )
    stale: Positive = Field(0.2, description="no cue for so long parks the rig, s")
    ramp_in: Positive = Field(2.0, description="soft start of a client's motion, s")
    future: Positive = Field(0.5, description="a cue may hold poses at most so far ahead, s")


class Parking(Settings):
    """Where and how fast the rig comes to rest."""

    pose: tuple[float, ...] = Field((), description="parked pose; empty: neutral")
    speed_share: Annotated[float, Field(gt=0.0, le=1.0)] = Field(
        0.3, description="share of the cue limits that parking uses"
    )


class Safety(Settings):
    """Limits of the gate and reactions' delays."""

    stroke_margin: NonNegative = Field(
        0.004, description="setpoints stay this far inside each stroke's ends, m"
    )
    following_error: Positive = Field(
        0.03, description="largest |setpoint - measured| of an actuator, m or rad"
    )
    answer_timeout: Positive = Field(
        0.1, description="a drive that answers nothing for so long is a fault, s"
    )
    overrun_cycles: Annotated[int, Field(ge=1, le=100)] = Field(
        5, description="so many cycles missed in a row park the rig"
    )
    drive_watchdog: Annotated[float, Field(ge=0.02, le=2.0)] = Field(
        0.1, description="the drives' own watchdog on our control frames, s"
    )
    stop_time: Positive = Field(
        1.0, description="a stop ramp not at rest by then ends in emergency, s"
    )

    @model_validator(mode="after")
    def _watchdog_is_not_slower_than_us(self) -> Safety:
        if self.drive_watchdog > 5.0 * self.answer_timeout:
            raise ValueError(
                f"drive_watchdog {self.drive_watchdog} s is over five times answer_timeout "
                f"{self.answer_timeout} s: a dead daemon would be noticed far too late"
            )
        return self
