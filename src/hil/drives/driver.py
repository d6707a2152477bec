"""What every drive driver offers to the control loop, whichever protocol it speaks.

A driver is pure: it is told the time, takes the frames that came in, and gives the frames to send.
Force is made only in phase ENABLED, which no driver reaches before it has read back the drive's own
watchdog and found it as the rig file wants it.
"""

from __future__ import annotations

from collections.abc import Iterator
from enum import Enum
from typing import NamedTuple, Protocol

from hil.drives.enquiry import Enquiry
from hil.drives.meaning import FrameMeaning, SetpointKind
from hil.frames import Frame
from hil.signals import Event, Sample


class PowerGoal(Enum):
    """What the rig wants of a drive's power stage."""

    OFF = "off"
    ON = "on"
    RESET = "reset"


class DrivePhase(Enum):
    """How far a drive has come. Each phase presumes the one before; FAULT is latched until RESET."""

    ABSENT = "absent"
    LOGGED_ON = "logged on"
    CONFIGURED = "configured"
    READY = "ready"
    ENABLED = "enabled"
    FAULT = "fault"


class DriveStatus(NamedTuple):
    """A driver's view of its drive."""

    phase: DrivePhase
    enabled: bool
    """The drive makes force."""
    referenced: bool
    """Its position counts from the rig file's zero."""
    enpo: bool
    """The hardware enable is seen to be there."""
    error: str | None
    """Why the phase is FAULT, a sentence."""
    waiting_for: str | None
    """What keeps it from READY, a sentence; None from READY on."""
    last_answer_s: float | None
    """When it last said anything, s."""
    watchdog_ok: bool
    """Its own watchdog has been written and read back since it last restarted or failed."""
    slots: int
    """Slots in which it could be asked."""
    pairs: int
    """Of these, requests that it answered."""
    repeats: int
    """Of these, answers "ask again"."""
    timeouts: int
    """Requests that it left unanswered."""
    garbage: int
    """Frames on its identifiers that are not what the protocol allows."""
    unasked: int
    """Answers to questions not asked."""


class DriveDriver(Protocol):
    """The master's side of one drive."""

    name: str
    setpoint_kind: SetpointKind
    """What it is told."""
    wire_kind: SetpointKind
    """What it makes of that for its drive."""

    @property
    def status(self) -> DriveStatus:
        """The drive as known now."""

    numbers: range
    """That its objects or parameters may have."""

    @property
    def held(self) -> frozenset[int]:
        """Numbers of the objects or parameters that hil itself writes and verifies."""

    def enquire(self, enquiry: Enquiry) -> None:
        """Read or write an object besides, when its turn comes."""

    def ids(self) -> frozenset[int]:
        """Identifiers of the frames that `on_frame` looks at."""

    def on_frame(self, now_s: float, frame: Frame) -> list[Sample | Event]:
        """Take a frame received at `now_s`, s; never raises on what came from the bus."""

    def on_slot(self, now_s: float, goal: PowerGoal, setpoint: float | None) -> list[Frame]:
        """Frames to send in the drive's slot. `setpoint` in SI; None holds the last one."""

    def take_events(self) -> list[Event]:
        """Events since the last call that `on_frame` has not handed out."""


class DriveBus(Protocol):
    """All drives of a rig, or those of one family on one bus, in the order of the rig file's actuators."""

    @property
    def is_synchronous(self) -> bool:
        """Whether `on_sync` has anything to send."""

    @property
    def meaning(self) -> FrameMeaning:
        """What the frames of these drivers ask, for the gate."""

    def __len__(self) -> int: ...

    def __getitem__(self, index: int) -> DriveDriver: ...

    def __iter__(self) -> Iterator[DriveDriver]: ...

    def on_frame(self, now_s: float, frame: Frame) -> list[Sample | Event]:
        """Hand a received frame to the drivers that it concerns."""

    def on_sync(self, now_s: float) -> list[Frame]:
        """The cycle begins now: frames to send before anything is reckoned."""

    def on_cycle(self, now_s: float) -> list[Frame]:
        """Frames that concern the whole bus; call once each cycle, before the slots."""

    def take_events(self) -> list[Event]:
        """Events of the bus and its drivers since the last call."""
