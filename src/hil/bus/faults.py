"""Faults that a simulated bus shows on script: rules, and how they are read from a file.

[[fault]]
kind = "drop"            # delay, duplicate, corrupt, truncate, foreign_id
ids = [0x371]            # which frames; without it all
probability = 0.05       # of those, how many
after_s = 10.0           # on the bus' own clock: the hub's starts when it does

[[fault]]
kind = "bus_off"         # or flood
node = "leg1"
at_s = 20.0
for_s = 2.0
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field

from hil.config.base import NonNegative, Positive, Settings, Share
from hil.configfile import load_settings
from hil.frames import EFF_MASK, SFF_MASK

StandardId = Annotated[int, Field(ge=0, le=SFF_MASK)]


class FrameFault(Settings):
    """Which frames a fault strikes; subclasses say what becomes of them."""

    ids: tuple[Annotated[int, Field(ge=0, le=EFF_MASK)], ...] | None = Field(
        None, description="identifiers it strikes; all without it"
    )
    sender: str | None = Field(None, description="only frames of this node")
    receiver: str | None = Field(None, description="only what this node receives")
    probability: Share = Field(1.0, description="share of matching frames that it strikes")
    skip: Annotated[int, Field(ge=0)] = Field(0, description="matching frames let pass first")
    count: Annotated[int, Field(ge=1)] | None = Field(
        None, description="strikes after which it ends; endless without it"
    )
    after_s: NonNegative = Field(0.0, description="strikes from here on, s on the bus' clock")
    until_s: Positive | None = Field(None, description="strikes up to here, s on the bus' clock")


class Drop(FrameFault):
    """The frame takes its time on the bus and is received by nobody (or not by `receiver`)."""

    kind: Literal["drop"] = "drop"


class Delay(FrameFault):
    """The frame is handed on late, as by a bridge or a busy host; others may overtake it."""

    kind: Literal["delay"] = "delay"
    by_s: Positive = Field(description="how late, s")


class Duplicate(FrameFault):
    """The frame is received twice: CAN repeats one whose last bit the sender saw disturbed."""

    kind: Literal["duplicate"] = "duplicate"


class Corrupt(FrameFault):
    """Random data bits are turned over, as by a sender with broken memory (the CRC is right)."""

    kind: Literal["corrupt"] = "corrupt"
    bits: Annotated[int, Field(ge=1, le=64)] = Field(1, description="bits turned over")


class Truncate(FrameFault):
    """The frame has fewer data bytes than its protocol wants."""

    kind: Literal["truncate"] = "truncate"
    length: Annotated[int, Field(ge=0, le=7)] = Field(description="data bytes left")


class ForeignId(FrameFault):
    """The frame comes under another identifier, as from a wrongly addressed node."""

    kind: Literal["foreign_id"] = "foreign_id"
    can_id: StandardId = Field(description="the identifier it gets")


class NodeOff(Settings):
    """A node's controller leaves the bus: its queue is lost, it neither sends nor receives."""

    kind: Literal["bus_off"] = "bus_off"
    node: str = Field(description="the node")
    at_s: NonNegative = Field(description="when, s on the bus' clock")
    for_s: Positive | None = Field(None, description="until it is restarted, s; never without it")


class Flood(Settings):
    """A foreign node sends one identifier again and again, as a babbling idiot does."""

    kind: Literal["flood"] = "flood"
    can_id: StandardId = Field(0, description="identifier; the lower, the more it displaces")
    data: Annotated[str, Field(pattern=r"^([0-9A-Fa-f]{2}){0,8}$")] = Field(
        "", description="data bytes, hexadecimal"
    )
    at_s: NonNegative = Field(0.0, description="from here on, s on the bus' clock")
    until_s: Positive | None = Field(None, description="up to here, s on the bus' clock")
    period_s: NonNegative = Field(0.0, description="time between its frames, s; 0 = no pause")


Fault = Annotated[
    Drop | Delay | Duplicate | Corrupt | Truncate | ForeignId | NodeOff | Flood,
    Field(discriminator="kind"),
]


class FaultScript(Settings):
    """The faults of one run, tried in the order in which they stand."""

    fault: tuple[Fault, ...] = Field((), description="rules")


def load_faults(path: Path) -> tuple[Fault, ...]:
    """The rules in the TOML file at `path`; ConfigError names file, key and bound."""
    return load_settings(path, FaultScript).fault
