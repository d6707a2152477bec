"""What can go wrong, and the one reaction to each: a table that the code follows and docs/safety.md shows.

While armed (drives powered, a person may be on the rig) and while disarmed (nothing can move) the same
cause asks for different things, so a row has a reaction for each.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum, unique
from types import MappingProxyType
from typing import Final, NamedTuple

from hil.signals import Event


@unique
class Cause(Enum):
    """Something that a running rig must react to."""

    CUE_STALE = "cue_stale"
    ANSWERS_LOST = "answers_lost"
    DRIVE_ERROR = "drive_error"
    ENPO_LOST = "enpo_lost"
    COURSE_LIMIT = "course_limit"
    OUTSIDE_STROKE = "outside_stroke"
    OVERSPEED = "overspeed"
    FOLLOWING_ERROR = "following_error"
    NO_MOTION = "no_motion"
    GATE_REFUSED = "gate_refused"
    OVERRUN = "overrun"
    BUS_OFF = "bus_off"
    BUS_BUSY = "bus_busy"
    GATEWAY_GONE = "gateway_gone"
    WATCHDOG_UNVERIFIED = "watchdog_unverified"
    STRIDE_MISMATCH = "stride_mismatch"
    DRIVE_REBOOTED = "drive_rebooted"
    DRIVE_NOT_ENABLED = "drive_not_enabled"
    POWER_ON_TIMEOUT = "power_on_timeout"
    RAMP_TIMEOUT = "ramp_timeout"
    LEAVE_TIMEOUT = "leave_timeout"
    SECOND_MASTER = "second_master"
    IMU_LOST = "imu_lost"


class Finding(NamedTuple):
    """A cause that is present, and the sentence that says where and how."""

    cause: Cause
    text: str


@unique
class Reaction(Enum):
    """What the rig does, from the mildest to the hardest."""

    NONE = "none"
    """Nothing depends on it."""
    WARN = "warn"
    """An event says so."""
    BLOCK = "block"
    """An event says so, and arming is refused while it lasts."""
    PARK = "park"
    """Jerk-limited ramp to the parked pose; the drives stay on; nothing is latched."""
    FAULT = "fault"
    """Latched. Jerk-limited ramp to the parked pose if every drive answers and is enabled, then drives
    off; emergency if one does not."""
    EMERGENCY = "emergency"
    """Latched. Drives disabled at once."""

    @property
    def severity(self) -> int:
        """Rank from mild (0) to hard."""
        return tuple(Reaction).index(self)


@dataclass(frozen=True, slots=True)
class Row:
    """The reactions to one cause, and why they are these."""

    armed: Reaction
    disarmed: Reaction
    why: str


_R = Reaction
REACTIONS: Final[Mapping[Cause, Row]] = MappingProxyType(
    {
        Cause.CUE_STALE: Row(
            _R.PARK,
            _R.NONE,
            "no fresh cue of its client while engaged: the client died or the network stalls",
        ),
        Cause.ANSWERS_LOST: Row(
            _R.EMERGENCY,
            _R.FAULT,
            "a drive that answers nothing cannot be led to the parked pose, and moving the others against "
            "it tilts the platform further; its own watchdog stops it too",
        ),
        Cause.DRIVE_ERROR: Row(
            _R.FAULT,
            _R.FAULT,
            "a drive reports an error (0x1B9 or its status); one that switched itself off meanwhile makes it "
            "an emergency",
        ),
        Cause.ENPO_LOST: Row(
            _R.EMERGENCY,
            _R.BLOCK,
            "the hardware enable is gone: power is cut and the drive has cleared its control word",
        ),
        Cause.COURSE_LIMIT: Row(
            _R.FAULT,
            _R.FAULT,
            "a drive reports that its course is limited: an end switch or a limit",
        ),
        Cause.OUTSIDE_STROKE: Row(
            _R.FAULT,
            _R.BLOCK,
            "a measured position beyond the stroke's end; the ramp leads back inside",
        ),
        Cause.OVERSPEED: Row(
            _R.EMERGENCY, _R.WARN, "measured faster than the drive may move: it has run away"
        ),
        Cause.FOLLOWING_ERROR: Row(
            _R.EMERGENCY,
            _R.NONE,
            "something holds the actuator or its encoder lies: a ramp would push on against it",
        ),
        Cause.NO_MOTION: Row(
            _R.EMERGENCY, _R.NONE, "commanded motion must produce measured motion, as above"
        ),
        Cause.GATE_REFUSED: Row(
            _R.FAULT,
            _R.WARN,
            "we asked for something forbidden: a defect of ours; emergency if the ramp is refused too",
        ),
        Cause.OVERRUN: Row(
            _R.PARK, _R.WARN, "overrun_cycles missed in a row: this computer cannot keep the cycle"
        ),
        Cause.BUS_OFF: Row(
            _R.EMERGENCY,
            _R.BLOCK,
            "nothing reaches the drives; their watchdogs stop them; they find themselves off afterwards",
        ),
        Cause.BUS_BUSY: Row(
            _R.PARK, _R.WARN, "the transmit queue stays full: setpoints would come late"
        ),
        Cause.GATEWAY_GONE: Row(
            _R.PARK, _R.WARN, "no cues, no commands and no recording without the gateway process"
        ),
        Cause.WATCHDOG_UNVERIFIED: Row(
            _R.FAULT,
            _R.BLOCK,
            "the dead-man is in the drive: without it nothing stops a dead daemon's rig",
        ),
        Cause.STRIDE_MISMATCH: Row(
            _R.EMERGENCY,
            _R.FAULT,
            "identifiers and addresses do not fit: frames may reach another drive",
        ),
        Cause.DRIVE_REBOOTED: Row(
            _R.EMERGENCY, _R.FAULT, "a drive logged on anew: it is off and has lost what we told it"
        ),
        Cause.DRIVE_NOT_ENABLED: Row(
            _R.EMERGENCY,
            _R.NONE,
            "a power stage went off by itself: the platform hangs on the others",
        ),
        Cause.POWER_ON_TIMEOUT: Row(
            _R.FAULT,
            _R.FAULT,
            "a drive did not come on after arming: nothing has moved yet, so it is all off",
        ),
        Cause.RAMP_TIMEOUT: Row(
            _R.EMERGENCY,
            _R.NONE,
            "a ramp was not at rest in its time: stop_time, or what parking may take",
        ),
        Cause.LEAVE_TIMEOUT: Row(
            _R.EMERGENCY,
            _R.NONE,
            "the daemon was told to end and the rig is not off in its time: nobody leads it any more",
        ),
        Cause.SECOND_MASTER: Row(
            _R.FAULT,
            _R.BLOCK,
            "someone else sends on our identifiers: two masters fight over the drives",
        ),
        Cause.IMU_LOST: Row(
            _R.WARN, _R.WARN, "the recording is poorer; no loop depends on the IMU"
        ),
    }
)
"""The reaction to each cause. docs/safety.md holds the same table; a test compares them."""


def reaction(cause: Cause, *, armed: bool) -> Reaction:
    """What the rig does about `cause`."""
    row = REACTIONS[cause]
    return row.armed if armed else row.disarmed


_CAUSE_OF_EVENT: Final[Mapping[str, Cause]] = MappingProxyType(
    {
        "drive_silent": Cause.ANSWERS_LOST,
        "drive_rebooted": Cause.DRIVE_REBOOTED,
        "enpo_lost": Cause.ENPO_LOST,
        "drive_dropped_out": Cause.DRIVE_NOT_ENABLED,
        "drive_not_enabled": Cause.POWER_ON_TIMEOUT,
        "course_limitation": Cause.COURSE_LIMIT,
        "stride_mismatch": Cause.STRIDE_MISMATCH,
    }
)
"""Names of drivers' events that are causes of their own; every other fault of theirs is a drive error."""


def finding_of(event: Event) -> Finding | None:
    """The cause in an event that a drive driver has told; None where it is no fault."""
    if event.severity != "fault":
        return None
    return Finding(_CAUSE_OF_EVENT.get(event.name, Cause.DRIVE_ERROR), event.text)
