"""What control and gateway process tell each other, as values.

Times are seconds of CLOCK_MONOTONIC, which both processes share; values are SI, and NaN stands for
"not known". `hil.daemon.wire` gives the bytes of each.
"""

from __future__ import annotations

from typing import Final, NamedTuple

from hil.frames import Frame
from hil.signals import IMU_QUANTITIES, Severity

MAX_AXES: Final = 6
"""Coordinates of a pose and actuators of a rig, at most."""
POSES_PER_RECORD: Final = 16
"""Timed poses that one CueRecord holds; longer cues travel in parts."""

RIG_STATES: Final = (
    "offline",
    "preparing",
    "parked",
    "ready",
    "engaged",
    "parking",
    "fault",
    "emergency",
)
QUANTITIES: Final = ("position", "velocity", "force", "current", *IMU_QUANTITIES)
KINDS: Final = ("position", "force", "velocity")
DRIVE_PHASES: Final = ("absent", "logged on", "configured", "ready", "enabled", "fault")
INPUTS: Final = (
    "start",
    "listen",
    "due",
    "cue",
    "command",
    "gateway",
    "refused",
    "refused_off",
    "end",
)
"""What a core can be told besides the frames it receives; "listen" is the start of a read-only one."""
SEVERITIES: Final[tuple[Severity, ...]] = ("info", "warning", "fault")

_NAN = float("nan")
NO_FRAME: Final = Frame(0)


class FrameRecord(NamedTuple):
    """A frame that was received (`is_sent` false) or sent at `t_s`."""

    t_s: float
    is_sent: bool
    frame: Frame


class ActuatorState(NamedTuple):
    """What is known of an actuator: m, m/s, N or rad, rad/s, N·m; `age_s` of its last position."""

    setpoint: float = _NAN
    position: float = _NAN
    velocity: float = _NAN
    force: float = _NAN
    age_s: float = _NAN


class StateRecord(NamedTuple):
    """The rig at `t_s`: one a control cycle."""

    t_s: float
    state: str
    pose: tuple[float, ...]
    """Observed pose, in the rig's order of coordinates, m or rad."""
    setpoint: tuple[float, ...]
    """Pose that the loop aims at, same order."""
    actuators: tuple[ActuatorState, ...]
    tracking_error: float = _NAN
    """Largest |setpoint - position| of the actuators, m or rad."""
    lateness_s: float = 0.0
    """How late this cycle began."""
    period_s: float = 0.0
    """Time since the cycle before this one began."""
    cycles: int = 0
    overruns: int = 0
    slots: int = 0
    pairs: int = 0
    """Slots in which a drive answered the parameter it was asked for."""
    bus_load: float = _NAN
    """Share of the bus's bit time in use, 0..1."""
    fault: str = ""


class SampleRecord(NamedTuple):
    """A measured value; `source` counts the rig's actuators, the IMU comes after the last one."""

    source: int
    quantity: str
    value: float
    sampled_s: float
    received_s: float


class SetpointRecord(NamedTuple):
    """A setpoint that went out to a drive at `t_s`."""

    t_s: float
    actuator: int
    kind: str
    value: float


class DriveRecord(NamedTuple):
    """A drive's status, sent when it changes; `error` keeps 120 bytes, empty where all is well."""

    t_s: float
    actuator: int
    phase: str
    enabled: bool
    error: str = ""


class EventRecord(NamedTuple):
    """An event; `name` keeps 48 bytes, `text` 240."""

    t_s: float
    severity: Severity
    name: str
    text: str


class ReplyRecord(NamedTuple):
    """The answer to the CommandRecord with the same id; `text` keeps 960 bytes."""

    command_id: int
    ok: bool
    text: str


class CueRecord(NamedTuple):
    """Part `part` of `parts` of a cue: up to 16 poses, each (dt_s, pose)."""

    client: str
    seq: int
    t_client_s: float
    received_s: float
    part: int
    parts: int
    poses: tuple[tuple[float, tuple[float, ...]], ...]


class CommandRecord(NamedTuple):
    """A command to control, with its argument as text (48 bytes at most)."""

    command_id: int
    name: str
    argument: str = ""


class InputRecord(NamedTuple):
    """Something that the core was told at `t_s`, for the journal from which a run is replayed.

    `number` counts all that it was told, received frames included, so that a loss on the way shows. The
    parts of a cue and a command follow as records of their own.
    """

    number: int
    t_s: float
    what: str
    """One of INPUTS."""
    frame: Frame = NO_FRAME
    """The frame that the bus refused; meaningless otherwise."""


class GatewayAlive(NamedTuple):
    """The gateway's heartbeat."""

    t_s: float
    is_recording: bool


Record = (
    FrameRecord
    | StateRecord
    | SampleRecord
    | SetpointRecord
    | DriveRecord
    | EventRecord
    | ReplyRecord
    | CueRecord
    | CommandRecord
    | InputRecord
    | GatewayAlive
)
