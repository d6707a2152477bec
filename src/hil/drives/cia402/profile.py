"""What a drive file (drives/<family>/drive.toml) says of a CiA 402 family, beside its EDS.

Units in the descriptions; unknown keys are errors. What an EDS cannot tell (torque unit, what a
drive does when its master falls silent, timing) is a setting here with a documented default in the file.
"""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import ConfigDict, Field, model_validator

from hil.config.base import NonNegative, Positive, Settings
from hil.drives.cia402.objects import INTEGERS, ObjectDictionary
from hil.errors import ConfigError, ProtocolError

Uint16 = Annotated[int, Field(ge=0, le=0xFFFF)]
Uint32 = Annotated[int, Field(ge=0, le=0xFFFF_FFFF)]
Missed = Literal["extrapolate", "hold", "fault"]

REQUIRED: tuple[tuple[int, int], ...] = (
    *((0x1000, 0), (0x1018, 1), (0x1018, 2), (0x1016, 1), (0x1017, 0), (0x6007, 0)),
    *((0x6040, 0), (0x6041, 0), (0x6060, 0), (0x6061, 0), (0x6064, 0), (0x6077, 0), (0x6502, 0)),
    *((0x1400, 1), (0x1400, 2), (0x1600, 0), (0x1600, 1), (0x1600, 2)),
    *((0x1800, 1), (0x1800, 2), (0x1A00, 0), (0x1A00, 1), (0x1A00, 2), (0x1A00, 3)),
)
"""Objects without which hil cannot run a drive."""


class Identity(Settings):
    """Who the node must be; None: whoever the EDS says, and where it is silent, anybody."""

    vendor: Uint32 | None = Field(None, description="0x1018:1")
    product: Uint32 | None = Field(None, description="0x1018:2")


class Supervision402(Settings):
    """Who watches whom. The master's heartbeat time is the rig file's safety.drive_watchdog."""

    master_node: Annotated[int, Field(ge=1, le=127)] = Field(
        127, description="node number of our heartbeat, which the drive watches (0x1016)"
    )
    abort_reaction: Literal[1, 2, 3] = Field(
        1, description="0x6007, our heartbeat is gone: 1 fault, 2 power off, 3 quick stop"
    )
    heartbeat: Positive = Field(0.05, description="0x1017, period of the drive's heartbeat, s")
    heartbeats_missed: Annotated[int, Field(ge=1)] = Field(
        3, description="so many of the drive's heartbeats missed: it is dead"
    )
    quick_stop_option: int = Field(2, description="0x605A: 2 slows down on the quick-stop ramp")
    following_error: Positive = Field(description="0x6065, window of the drive itself, m or rad")
    following_time: NonNegative = Field(0.02, description="0x6066, outside it for so long, s")
    wrong_pdos: Annotated[int, Field(ge=1)] = Field(
        3, description="so many PDOs of a wrong length in a row are a fault"
    )


class Timing402(Settings):
    """Times of the protocol, s."""

    listen: Positive = Field(0.25, description="silence of ours before the first frame, s")
    poll: Positive = Field(0.5, description="a node that says nothing is asked so often, s")
    sdo_timeout: Positive = Field(
        0.2, description="an SDO answer later than this is asked again, s"
    )
    sdo_tries: Annotated[int, Field(ge=1)] = Field(2, description="requests before giving up")
    status_timeout: Positive = Field(0.1, description="no process data for so long: dead, s")
    enable_timeout: Positive = Field(1.0, description="longest from the enable command to force, s")
    off_timeout: Positive = Field(
        0.3, description="longest from the off command to no force, s: then our heartbeat stops"
    )
    reset_hold: Positive = Field(0.02, description="reset bit low, then high, for so long each, s")


class Homing402(Settings):
    """How the drive finds the rig file's zero."""

    kind: Literal["absolute", "drive"] = Field(
        description="absolute: encoders know the zero; drive: `hil drive home` first"
    )
    referenced_index: Uint16 | None = Field(
        None, description="object whose bit 0 says that the drive is referenced"
    )
    method: int = Field(37, ge=-128, le=127, description="0x6098; 37: here is the zero")
    speed: Positive = Field(0.01, description="0x6099:1, towards the switch, m/s")
    speed_to_zero: Positive = Field(0.002, description="0x6099:2, from the switch to the zero, m/s")
    offset: float = Field(
        0.0, description="0x607C: where the zero found is, in the rig file's coordinates, m or rad"
    )
    acceleration: Positive = Field(0.1, description="0x609A, m/s²")
    timeout: Positive = Field(60.0, description="longest, s")

    @model_validator(mode="after")
    def _can_be_told(self) -> Self:
        if self.kind == "drive" and self.referenced_index is None:
            raise ValueError(
                'kind = "drive" needs referenced_index: nothing else tells it is homed'
            )
        return self


class Simulated402(Settings):
    """What only the drive's simulation needs to know."""

    missed_setpoints: tuple[Missed, Missed, Missed] = Field(
        ("extrapolate", "hold", "hold"),
        description="what the drive does on the first, second, third and further setpoint missed in a row",
    )
    quick_stop: Positive = Field(0.2, description="from a fault or quick stop to power off, s")
    switches: NonNegative = Field(
        0.005, description="limit switches, so far inside both ends of the stroke, m or rad"
    )
    boot: NonNegative = Field(0.3, description="from power-on to the boot-up message, s")
    modes: Uint32 = Field(
        0x03E5, description="0x6502: pp, pv, ip... by bit; 6 ip, 7 csp, 8 csv, 9 cst"
    )


class Expected(Settings):
    """An object that must hold a value before the drive may be started: it is read, never written."""

    index: Uint16
    sub: Annotated[int, Field(ge=0, le=255)] = 0
    value: int
    text: str = Field(description="what goes wrong where it holds another")


class EmergencyCode(Settings):
    """An emergency error code of the drive."""

    code: Uint16
    text: str


class Cia402Profile(Settings):
    """A drive family that speaks CANopen and CiA 402."""

    format: Literal["hil-drive/1"] = "hil-drive/1"
    name: str
    protocol: Literal["canopen"]
    eds: str = Field("device.eds", description="electronic data sheet, beside this file")
    identity: Identity = Identity()
    homing: Homing402
    supervision: Supervision402
    timing: Timing402 = Timing402()
    simulated: Simulated402 = Simulated402()
    expected: tuple[Expected, ...] = Field(
        (), description="what the drive must hold and hil never writes: polarity, gear, feed ..."
    )
    emergencies: tuple[EmergencyCode, ...] = ()
    objects: ObjectDictionary = Field(
        default_factory=lambda: ObjectDictionary({}), exclude=True, description="the EDS, once read"
    )

    model_config = ConfigDict(
        extra="forbid", frozen=True, allow_inf_nan=False, arbitrary_types_allowed=True
    )

    def error_text(self, code: int) -> str:
        """Meaning of an emergency error code; by its class where the file does not list it."""
        for known in self.emergencies:
            if known.code == code:
                return f"{code:#06x} ({known.text})"
        return f"{code:#06x} ({CLASSES.get(code & 0xFF00, CLASSES.get(code & 0xF000, 'unknown class'))})"

    def with_objects(self, objects: ObjectDictionary) -> Cia402Profile:
        """The profile with its EDS; ConfigError where the two do not fit or the EDS is no such drive's."""
        lacking = [f"{i:#06x}:{s:02x}" for i, s in REQUIRED if (i, s) not in objects]
        if lacking:
            raise ConfigError(
                f"{objects.source}: is no EDS of a drive that hil can run: it lacks {', '.join(lacking)}"
            )
        for (index, sub), size in (
            ((0x6040, 0), 2),
            ((0x6041, 0), 2),
            ((0x6064, 0), 4),
            ((0x6077, 0), 2),
        ):
            if objects[index, sub].size != size:
                raise ConfigError(
                    f"{objects.source}: {objects[index, sub]} has {objects[index, sub].size} bytes, "
                    f"CiA 402 gives it {size}: the EDS is wrong"
                )
        for want in self.expected:
            name = f"{self.name}: expected: {want.index:#06x}:{want.sub:02x}"
            if (want.index, want.sub) not in objects:
                raise ConfigError(f"{name} is not in {objects.source}: take it out, or correct it")
            entry = objects[want.index, want.sub]
            if not entry.readable or entry.data_type not in INTEGERS:
                raise ConfigError(f"{name}: {entry} is no whole number that can be read")
            try:
                entry.encode(want.value)
            except ProtocolError as error:
                raise ConfigError(f"{name}: {error}") from error
        for key in ("vendor", "product"):
            ours, theirs = getattr(self.identity, key), getattr(objects, key)
            if ours is not None and theirs is not None and ours != theirs:
                raise ConfigError(
                    f"{self.name}: identity.{key} = {ours:#x}, but {objects.source} is of {theirs:#x}: "
                    "wrong EDS for this drive, or wrong identity"
                )
        return self.model_copy(update={"objects": objects})


CLASSES = {
    0x1000: "generic error",
    0x2000: "current",
    0x3000: "voltage",
    0x4000: "temperature",
    0x5000: "device hardware",
    0x6000: "device software",
    0x7000: "additional modules",
    0x8100: "communication",
    0x8200: "protocol error",
    0x8000: "monitoring",
    0x9000: "external error",
    0xF000: "additional functions",
    0xFF00: "device specific",
}
"""Error classes of CiA 301's emergency error codes [M]."""
