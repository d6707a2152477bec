"""What can be asked of an experiment: one model a kind, every option with unit and bound.

A plan says what is wanted, not yet what the rig allows. SI units and radians throughout.
"""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from hil.config.base import NonNegative, Positive, Settings

Frequency = Annotated[float, Field(gt=0.0, le=50.0)]
Duration = Annotated[float, Field(gt=0.0, le=3600.0)]
Fade = Annotated[float, Field(ge=0.2, le=120.0)]
Count = Annotated[int, Field(ge=1, le=1000)]


class Moving(Settings):
    """What nearly every kind of experiment may be told."""

    coordinates: tuple[str, ...] = Field(
        (), description="coordinates to move, several move at once; empty: the kind's own choice"
    )
    amplitude: tuple[Positive, ...] = Field(
        (), description="one for all coordinates or one each; empty: what `share` allows"
    )
    share: Annotated[float, Field(ge=0.01, le=0.95)] = Field(
        0.5, description="of the limit that is reached first, where no amplitude is given"
    )


class Band(Moving):
    """What moves with a band of frequencies."""

    f_min: Frequency = Field(0.1, description="lowest frequency, Hz")
    f_max: Frequency = Field(5.0, description="highest frequency, Hz")

    @model_validator(mode="after")
    def _rises(self) -> Self:
        if self.f_max < self.f_min:
            raise ValueError(f"f_max {self.f_max:g} Hz lies below f_min {self.f_min:g} Hz")
        return self


class Step(Moving):
    """Up, rest, down, rest: rest to rest with smooth jerk, in coordinates or in single actuators."""

    kind: Literal["step"] = "step"
    actuators: tuple[str, ...] = Field(
        (), description="step of these actuators instead of coordinates, through forward kinematics"
    )
    size: Annotated[float, Field(gt=0.0, le=1.0)] = Field(
        0.01,
        description="height of the step where no amplitude is given, m or rad (published: 1 cm)",
    )
    hold_s: Annotated[float, Field(ge=0.1, le=60.0)] = Field(2.0, description="rest after each, s")
    count: Count = Field(3, description="how often up and down")


class Chirp(Band):
    """Sine of constant amplitude in displacement (m, rad) with rising frequency."""

    kind: Literal["chirp"] = "chirp"
    law: Literal["linear", "log"] = Field("linear", description="how the frequency rises")
    duration_s: Duration = Field(60.0, description="time of the rise, s")
    fade_s: Fade = Field(3.0, description="fade of the acceleration in and out, s")


class Sweep(Band):
    """Sine of constant amplitude in acceleration (m/s², rad/s²), exponentially rising in frequency."""

    kind: Literal["sweep"] = "sweep"
    f_min: Frequency = Field(0.2, description="lowest frequency, Hz; held for one period first")
    f_max: Frequency = Field(3.0, description="highest frequency, Hz")
    duration_s: Duration = Field(60.0, description="time of the rise, s")
    fade_s: Fade = Field(3.0, description="fade of the acceleration in and out, s")


class Multisine(Band):
    """Random-phase multisine, periodic, in several realisations; amplitude: its peak in m or rad."""

    kind: Literal["multisine"] = "multisine"
    period_s: Annotated[float, Field(ge=0.5, le=600.0)] = Field(
        10.0, description="after which the motion repeats, s"
    )
    f_min: Frequency = Field(0.1, description="lowest line, Hz")
    f_max: Frequency = Field(3.0, description="highest line, Hz")
    lines: Literal["full", "odd", "odd_random"] = Field(
        "odd_random",
        description="full: every multiple of 1/period; odd: odd multiples; odd_random: odd ones of which "
        "one in each `group` stays empty, drawn at random, to detect odd distortion",
    )
    group: Annotated[int, Field(ge=2, le=20)] = Field(
        4, description="odd lines to a detection line"
    )
    harmonics: tuple[Annotated[int, Field(ge=1)], ...] = Field(
        (), description="chosen multiples of 1/period instead of f_min, f_max and lines"
    )
    spectrum: Literal["position", "velocity", "acceleration"] = Field(
        "velocity", description="in which all lines are equally strong"
    )
    periods: Count = Field(2, description="to measure, in each realisation")
    settle_periods: Annotated[int, Field(ge=0, le=100)] = Field(
        1, description="before them, not for measuring"
    )
    realisations: Count = Field(2, description="draws of random phases")
    draws: Count = Field(
        20, description="phases tried for each, the smallest crest factor is taken"
    )
    phase_seed: Annotated[int, Field(ge=0)] = Field(0, description="of phases and detection lines")
    fade_s: Fade = Field(2.0, description="fade of the acceleration in and out, s")

    @model_validator(mode="after")
    def _is_bounded(self) -> Self:
        if self.f_max * self.period_s > 20_000:
            raise ValueError(f"{self.f_max * self.period_s:.0f} lines are more than 20000")
        return self


class Circle(Moving):
    """Circle in two coordinates at constant speed; amplitude: its radius, m or rad."""

    kind: Literal["circle"] = "circle"
    period_s: Annotated[float, Field(ge=1.0, le=600.0)] = Field(
        40.0, description="once round, s (published)"
    )
    turns: Count = Field(1, description="whole turns at constant speed")
    fade_s: Fade = Field(10.0, description="way out to the circle and back, in acceleration, s")


class Heave(Moving):
    """Sinusoid, in heave where the rig has it; amplitude in m or rad."""

    kind: Literal["heave"] = "heave"
    frequency: Frequency = Field(0.25, description="of the sinusoid, Hz")
    cycles: Count = Field(10, description="at full amplitude")
    fade_s: Fade = Field(4.0, description="fade of the acceleration in and out, s")


class Custom(Settings):
    """Any motion of a CSV file with t (s) and coordinates (m, rad); only ever scaled down."""

    kind: Literal["custom"] = "custom"
    file: str = Field(description="CSV with a column t and one a coordinate")
    sha256: str = Field("", description="of the file; filled in")
    cutoff: NonNegative = Field(0.0, description="of a zero-phase low-pass first, Hz; 0: none")


Plan = Step | Chirp | Sweep | Multisine | Circle | Heave | Custom
PLANS: dict[str, type[Plan]] = {
    "step": Step,
    "chirp": Chirp,
    "sweep": Sweep,
    "multisine": Multisine,
    "circle": Circle,
    "heave": Heave,
    "custom": Custom,
}
"""Models by the name of the kind."""
