"""What a check finds, and how far drives are asked."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Level = Literal["ok", "warn", "fault"]


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing that was looked at. `fault`: the rig will not run; `warn`: it will run worse."""

    level: Level
    topic: str
    text: str
    remedy: str = ""
    """What to do, where something is wrong."""


@dataclass(frozen=True, slots=True)
class Probe:
    """How far the drives are asked."""

    listen_s: float = 0.6
    """How long the bus is listened to."""
    asks: bool = False
    """Read one parameter of each drive."""
    prepares: bool = False
    """Prepare the drives as for arming, power off."""
