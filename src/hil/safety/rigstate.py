"""The rig's state as a value, and the few changes of it that have a name."""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import Enum, unique
from math import inf
from typing import Final

from hil.drives.driver import PowerGoal
from hil.safety.reactions import Cause, Finding

BLOCK_S: Final = 2.0
"""A cause that blocks arming does so for this long after it was last seen."""


@unique
class StateName(Enum):
    """States of a rig, as published."""

    OFFLINE = "offline"
    """No drive is on the bus."""
    PREPARING = "preparing"
    """Drives log on, are configured and find their reference."""
    PARKED = "parked"
    """At rest. Cues move nothing. Drives off, or, while armed, holding."""
    READY = "ready"
    """Armed and at rest; a fresh cue engages."""
    ENGAGED = "engaged"
    """Follows the cues."""
    PARKING = "parking"
    """On the way to the parked pose, or stopped on it by a person."""
    FAULT = "fault"
    """Latched: ramps to rest if it can, then drives off, until a person resets."""
    EMERGENCY = "emergency"
    """Latched: drives off at once, until a person resets."""


@unique
class MotionGoal(Enum):
    """What the shaped motion is to do."""

    NONE = "none"
    """The drives are off: the setpoint is the measured pose."""
    HOLD = "hold"
    """Come to rest, jerk-limited, and stay."""
    PARK = "park"
    """Go to the parked pose, jerk-limited, and stay."""
    FOLLOW = "follow"
    """Follow the cues, after a soft ramp-in."""


@dataclass(frozen=True, slots=True)
class RigState:
    """What the state machine remembers from step to step."""

    name: StateName = StateName.OFFLINE
    since_s: float = -inf
    armed: bool = False
    """The gate's latch: drives may be powered."""
    armed_s: float = -inf
    energised: bool = False
    """Every drive has been enabled since arming."""
    held: bool = False
    """A person has said stop: the motion comes to rest and stays, until park or disarm."""
    resetting_s: float = -inf
    """Until then the drives are asked to reset their errors."""
    deadline_s: float = inf
    """When a ramp to rest must have come to rest."""
    resume_s: float = -inf
    """Until then a fresh cue of `client` engages the parked rig: it went stale only a little while ago."""
    client: str | None = None
    """Whose cues have engaged the rig last."""
    fault: Finding | None = None
    seen: tuple[tuple[Cause, float], ...] = ()
    """When each cause was last seen, so that each is told once and blocks arming for a while."""

    @property
    def latched(self) -> bool:
        """A person must reset."""
        return self.name in (StateName.FAULT, StateName.EMERGENCY)

    @property
    def power(self) -> PowerGoal:
        """What the drives' power stages are to do."""
        if self.armed:
            return PowerGoal.ON
        return PowerGoal.RESET if self.resetting_s > -inf else PowerGoal.OFF

    @property
    def motion(self) -> MotionGoal:
        """What the shaped motion is to do."""
        if not self.armed:
            return MotionGoal.NONE
        if self.held or not self.energised or self.name in (StateName.PARKED, StateName.READY):
            return MotionGoal.HOLD
        return MotionGoal.FOLLOW if self.name is StateName.ENGAGED else MotionGoal.PARK

    def to(self, name: StateName, now_s: float) -> RigState:
        """In another state, entered now."""
        return self if name is self.name else replace(self, name=name, since_s=now_s)

    def arm(self, now_s: float) -> RigState:
        """With the latch closed, if it was open; and no longer waiting for a cue to come back."""
        if self.armed:
            return replace(self, resume_s=-inf)
        return replace(self, armed=True, armed_s=now_s, energised=False, held=False)

    def disarm(self) -> RigState:
        """With the latch open: drives off."""
        return replace(
            self, armed=False, energised=False, held=False, deadline_s=inf, resume_s=-inf
        )

    def engage(self, client: str | None, now_s: float) -> RigState:
        """Following the cues of `client`."""
        return replace(self, client=client, resume_s=-inf).to(StateName.ENGAGED, now_s)

    def park(self, now_s: float, within_s: float, resume_s: float = -inf) -> RigState:
        """On the way to the parked pose."""
        start = replace(self, held=False, deadline_s=now_s + within_s, resume_s=resume_s)
        return start.to(StateName.PARKING, now_s)

    def hold(self, now_s: float, within_s: float) -> RigState:
        """Coming to rest on the spot."""
        return replace(self, held=True, deadline_s=now_s + within_s, resume_s=-inf)

    def at_rest(self, now_s: float) -> RigState:
        """Parked, drives as they are."""
        return replace(self, held=False, deadline_s=inf).to(StateName.PARKED, now_s)

    def saw(self, cause: Cause, now_s: float) -> RigState:
        """With `cause` seen now."""
        others = tuple(entry for entry in self.seen if entry[0] is not cause)
        return replace(self, seen=(*others, (cause, now_s)))

    def seen_lately(self, cause: Cause, now_s: float) -> bool:
        """Whether `cause` was seen within the last BLOCK_S."""
        return any(c is cause and now_s - t <= BLOCK_S for c, t in self.seen)
