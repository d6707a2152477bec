"""What a drive file (drives/<family>/drive.toml) says of a CANLust drive family.

What no public source tells of these drives is a setting here, with a documented default in the file,
so that a rig owner who knows better sets it. Units in the descriptions; unknown keys are errors.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from hil.config.base import NonNegative, Positive, Settings

WireType = Literal["int32", "int32q16", "fixpoint16", "float32"]
"""Data types of parameters (manual CM-CAN1, tables 4.1 and 4.2) [F]; all travel as four bytes."""

BaseId = Annotated[int, Field(ge=0x001, le=0x7FF)]
Number = Annotated[int, Field(ge=0, le=0xFFFF)]
Byte = Annotated[int, Field(ge=0, le=0xFF)]

GROUP: int = 220
"""Identifiers in a CAL priority group; a drive's offset must stay below it."""


class BaseIds(Settings):
    """Identifiers of address 0; a drive's own are base + stride * address."""

    system: BaseId = Field(description="System Start/Stop, one frame for all drives")
    error: BaseId = Field(description="drive's error frame")
    control: BaseId = Field(description="control word and reference")
    status: BaseId = Field(description="status word and actual value")
    request: BaseId = Field(description="parameter request")
    answer: BaseId = Field(description="parameter answer")
    log_on: BaseId = Field(description="drive's log-on")
    stride: Literal[1, 2] = Field(description="identifiers from one address to the next")

    @model_validator(mode="after")
    def _groups_are_apart(self) -> Self:
        bases = sorted(
            (self.error, self.control, self.status, self.request, self.answer, self.log_on)
        )
        for low, high in pairwise(bases):
            if high - low < GROUP:
                raise ValueError(f"{low:#x} and {high:#x} are closer than a group of {GROUP}")
        return self


class SystemBytes(Settings):
    """Byte 0 of the System frame."""

    start: Byte = Field(description="starts: stored control words act, watchdogs run")
    stop: Byte = Field(description="stops: drives store control words and log on again")


class Layout(Settings):
    """How control and status frames are laid out."""

    kind: Literal["drivecom", "posmod"] = Field(
        description="drivecom: DRIVECOM control and status words; posmod: bits of positioning mode"
    )
    value_byte: Annotated[int, Field(ge=2, le=4)] = Field(
        description="first of four bytes of reference and actual value, int32 little endian"
    )
    flags_byte: Annotated[int, Field(ge=2, le=7)] = Field(
        description="byte of the flags referenced (bit 0) and automatic (bit 1)"
    )
    status_carries_position: bool = Field(
        description="the actual value is the position in increments, and is taken as a sample"
    )
    torque_reference: bool = Field(
        description="the reference may be a torque: force setpoints work"
    )

    @model_validator(mode="after")
    def _fields_are_apart(self) -> Self:
        if self.value_byte <= self.flags_byte < self.value_byte + 4:
            raise ValueError(
                f"flags_byte {self.flags_byte} lies inside the value's bytes "
                f"{self.value_byte}..{self.value_byte + 3}"
            )
        return self


class ErrorLayout(Settings):
    """Where the error frame holds what."""

    code_byte: Annotated[int, Field(ge=0, le=7)] = Field(description="error number")
    location_byte: Annotated[int, Field(ge=0, le=7)] = Field(description="error location")
    hours_byte: Annotated[int, Field(ge=0, le=6)] = Field(
        description="first of two bytes of the operating hours, little endian"
    )

    @model_validator(mode="after")
    def _fields_are_apart(self) -> Self:
        taken = (self.code_byte, self.location_byte, self.hours_byte, self.hours_byte + 1)
        if len(set(taken)) != len(taken):
            raise ValueError(f"code, location and hours share a byte: {taken}")
        return self


class Parameter(Settings):
    """A parameter of the drive: SI value = wire value * scale."""

    number: Number
    type: WireType = Field("int32", description="data type on the wire")
    scale: Positive = Field(1.0, description="SI unit (or rig file's count) per unit on the wire")


class Watchdog(Settings):
    """The drive's own watchdog on control frames."""

    number: Number
    unit: Positive = Field(description="s per increment")
    largest: Annotated[int, Field(ge=1)] = Field(description="largest value it takes, increments")


class OperatingMode(Settings):
    """The parameter that chooses what the reference means."""

    number: Number
    position: int = Field(description="its value for position references")
    force: int = Field(description="its value for torque references")


class Measurements(Settings):
    """Parameters that hold measured values; position, force and current scale by the rig file."""

    position: Parameter
    velocity: Parameter
    force: Parameter
    current: Parameter


class PreControl(Settings):
    """Shares (0 off, 1 whole) of the set speed, inertia force and friction that are fed forward."""

    velocity: Parameter
    acceleration: Parameter
    friction: Parameter


class LoopGains(Settings):
    """Gains of the drive's loops: 1/s, N·s/m, N/m at the actuator's output."""

    position: Parameter
    speed: Parameter
    integral: Parameter


class Parameters(Settings):
    """The parameters that hil reads and writes."""

    watchdog: Watchdog
    operating_mode: OperatingMode
    measurements: Measurements
    precontrol: PreControl
    gains: LoopGains


class Timing(Settings):
    """Times of the protocol, s."""

    log_on_period: Positive = Field(description="between two log-on frames of a drive, s")
    listen: Positive = Field(description="silence of ours before the first frame, s")
    status_timeout: Positive = Field(description="no status for so long: the drive is dead, s")
    answer_wait: Positive = Field(description="an answer later than this is asked for again, s")
    status_period: NonNegative = Field(
        description="between two status frames, s; 0: one for each control frame"
    )
    enable_timeout: Positive = Field(description="longest from the enable command to force, s")
    reset_hold: Positive = Field(description="reset bit low, then high, for so long each, s")
    repeat_limit: Annotated[int, Field(ge=1)] = Field(
        description='"ask again" so many times in a row is a fault'
    )


class Supervision(Settings):
    """What the drive watches by itself, as its simulation does too."""

    following_error: Positive = Field(description="largest |reference - position|, m or rad")
    quick_stop: Positive = Field(description="from a fault to power off, s")


class ErrorCode(Settings):
    """An error number of the drive."""

    code: Byte
    name: str = Field(description="as on the drive's display")
    text: str = Field(description="what it means")
    kind: Literal["watchdog", "course_limitation", "following_error", "other"] = "other"


class LustProfile(Settings):
    """A drive family that speaks CANLust."""

    format: Literal["hil-drive/1"] = "hil-drive/1"
    name: str
    protocol: Literal["canlust"]
    ids: BaseIds
    system: SystemBytes
    layout: Layout
    error_frame: ErrorLayout
    parameters: Parameters
    timing: Timing
    supervision: Supervision
    homing: Literal["absolute", "drive"] = Field(
        description="absolute: encoders know the rig file's zero; drive: the drive homes itself first"
    )
    errors: tuple[ErrorCode, ...]

    @model_validator(mode="after")
    def _codes_are_unique(self) -> Self:
        codes = [e.code for e in self.errors]
        if len(set(codes)) != len(codes):
            raise ValueError(f"errors: codes are not unique: {sorted(codes)}")
        for kind in ("watchdog", "course_limitation", "following_error"):
            if sum(e.kind == kind for e in self.errors) != 1:
                raise ValueError(f'errors: exactly one entry needs kind = "{kind}"')
        return self

    def error_text(self, code: int) -> str:
        """Name and meaning of an error number."""
        for error in self.errors:
            if error.code == code:
                return f"{error.name} ({error.text})"
        return f"error {code}, which the drive file does not explain"

    def code_of(self, kind: str) -> int:
        """Error number of a kind of error."""
        return next(e.code for e in self.errors if e.kind == kind)
