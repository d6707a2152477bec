"""What the phases of a drive are judged by: its status, its preparation, and its family's times and words."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from hil.drives.power import PowerState


class Reported(Protocol):
    """What a drive's status says, whatever the family."""

    @property
    def power(self) -> PowerState:
        """State of its power stage."""

    @property
    def enpo(self) -> bool:
        """Its hardware enable is there."""

    @property
    def referenced(self) -> bool:
        """Its position counts from the rig file's zero."""


class Preparation(Protocol):
    """What is written to a drive and read back before it may be enabled."""

    failure: str | None
    failure_name: str
    """Stable name of the failure."""
    notes: list[str]

    @property
    def done(self) -> bool:
        """All of it is verified."""

    @property
    def watchdog_ok(self) -> bool:
        """The drive's own watchdog is verified."""

    def restart(self) -> None:
        """Nothing is verified any more."""


@dataclass(frozen=True, slots=True)
class PhaseSettings:
    """A family's times, s, and words."""

    repeat_s: float
    """A sign of a fresh start within this after the last one means nothing new."""
    status_timeout_s: float
    enable_timeout_s: float
    off_timeout_s: float
    reset_hold_s: float
    absolute: bool
    """Its encoder knows the rig file's zero."""
    absent: str
    """What to say of a drive that was not heard."""
    unstarted: str
    """What to say of a configured drive that was not started."""
    enable_input: str
    """Name of its hardware enable."""
    tells_unstarted: bool
    """It sends its status before it is started."""
