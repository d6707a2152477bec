"""Values that travel between the parts of a running rig: samples from drives, cues from clients."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, NamedTuple

Quantity = Literal["position", "velocity", "force", "current"]
"""What a drive can be asked for. m or rad, m/s or rad/s, N or N·m, A — at the actuator's output."""

IMU_QUANTITIES = ("gyro_x", "gyro_y", "gyro_z", "accel_x", "accel_y", "accel_z")
"""Angular rate (rad/s) and specific force (m/s²) in the sensor frame."""

Severity = Literal["info", "warning", "fault"]
"""fault: the rig leaves normal operation; warning: somebody should look; info: neither."""


class Sample(NamedTuple):
    """One measured value. `source` is an actuator's name or "imu"."""

    source: str
    quantity: str
    value: float
    sampled_s: float
    """Instant at which the value held, by the nominal answer delay, s."""
    received_s: float
    """Instant at which its frame was received, s."""


@dataclass(frozen=True, slots=True)
class TimedPose:
    """A pose asked for `dt_s` after the cue's own time, in the rig's order of coordinates."""

    dt_s: float
    pose: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class Cue:
    """A motion cue as it arrived: one or many timed poses from one client."""

    client: str
    seq: int
    t_client_s: float
    received_s: float
    poses: tuple[TimedPose, ...]


@dataclass(frozen=True, slots=True)
class Event:
    """Something worth telling a person: `name` is stable and greppable, `text` is a sentence."""

    t_s: float
    severity: Severity
    name: str
    text: str
