"""Which column of a foreign log becomes which coordinate, and how.

In one line: `roll=lean_angle:rad*0.5@2, pitch=speed:km/h, t=time:ms`, that is
coordinate=column:unit, then *scale and @low-pass in Hz where wanted. Or as a TOML file:

    rate_hz = 100.0                     # or: time = { column = "time", unit = "ms" }
    [[channel]]
    coordinate = "roll"
    column = "lean_angle"
    unit = "rad"
    scale = 0.5
    low_pass_hz = 2.0
    [file]
    decimal = ","                       # and all else that a map of `hil runs import` may say there

The unit says what the column is and so what is done with it: an angle or a length is the pose itself;
an acceleration becomes tilt or translation by washout, a speed is differentiated to one, an angular
rate becomes an angle by washout. Channels of the same coordinate add up.
"""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import Annotated, Final

from pydantic import Field

from hil.config.base import Positive, Settings
from hil.config.rig import ROTATIONS
from hil.configfile import load_settings
from hil.errors import ConfigError
from hil.runs.importing.mapfile import FileSettings
from hil.runs.importing.units import UNITS

TIME_UNITS: Final = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}

_ALLOWED: Final[dict[str, tuple[str, ...]]] = {
    "angle": (*ROTATIONS, "position"),
    "length": ("surge", "sway", "heave", "position"),
    "angular rate": ROTATIONS,
    "speed": ("pitch", "surge"),
    "acceleration": ("pitch", "roll", "surge", "sway", "heave"),
}
"""By kind of quantity, as the table of units has it."""
_UNITS: Final = tuple(name for name, (kind, _) in UNITS.items() if kind in _ALLOWED)
_CHANNEL: Final = re.compile(
    r"(?P<coordinate>\w+)\s*=\s*(?P<column>[^:*@]+?)\s*:\s*(?P<unit>[\w/]+)"
    r"(?:\s*\*\s*(?P<scale>[-+.\deE]+))?(?:\s*@\s*(?P<low_pass>[.\deE+-]+))?"
)


class Channel(Settings):
    """One column on its way to one coordinate."""

    coordinate: str
    column: str
    unit: str
    scale: float = 1.0
    low_pass_hz: Positive | None = Field(None, description="zero-phase low-pass, Hz")

    @property
    def kind(self) -> str:
        """What the column measures."""
        return UNITS[self.unit][0]

    @property
    def factor(self) -> float:
        """From the column's numbers to scaled SI."""
        return UNITS[self.unit][1] * self.scale


class TimeColumn(Settings):
    """The log's time."""

    column: str
    unit: str = "s"


class CueMap(Settings):
    """All channels of a map; a log has either a time column or a fixed rate."""

    channel: Annotated[tuple[Channel, ...], Field(min_length=1)]
    time: TimeColumn | None = None
    rate_hz: Positive | None = Field(None, description="sampling rate of a log without time, Hz")
    file: FileSettings = FileSettings()


def read_cue_map(text: str) -> CueMap:
    """The map in one line, or in the TOML file of that name; ConfigError says what is wrong."""
    if text.endswith(".toml"):
        return _checked(load_settings(Path(text), CueMap), text)
    return _checked(_parse(text), "map")


def _parse(text: str) -> CueMap:
    channels: list[Channel] = []
    time: TimeColumn | None = None
    for part in filter(None, (p.strip() for p in text.split(","))):
        found = _CHANNEL.fullmatch(part)
        if found is None:
            raise ConfigError(
                f"map: {part!r} is not coordinate=column:unit, with *scale and @low-pass in Hz "
                "after it where wanted"
            )
        try:
            scale = float(found["scale"] or 1.0)
            low_pass = float(found["low_pass"]) if found["low_pass"] else None
        except ValueError as error:
            raise ConfigError(f"map: {part!r}: {error}") from error
        if not math.isfinite(scale) or (low_pass is not None and not 0.0 < low_pass < math.inf):
            raise ConfigError(f"map: {part!r}: scale must be finite and the low-pass above 0 Hz")
        if found["coordinate"] == "t":
            if found["scale"] or found["low_pass"]:
                raise ConfigError(f"map: {part!r}: time is neither scaled nor filtered")
            time = TimeColumn(column=found["column"], unit=found["unit"])
            continue
        channels.append(
            Channel(
                coordinate=found["coordinate"],
                column=found["column"],
                unit=found["unit"],
                scale=scale,
                low_pass_hz=low_pass,
            )
        )
    if not channels:
        raise ConfigError("map: names no coordinate; an example: roll=lean_angle:rad*0.5")
    return CueMap(channel=tuple(channels), time=time)


def _checked(cue_map: CueMap, source: str) -> CueMap:
    if cue_map.time is not None and cue_map.time.unit not in TIME_UNITS:
        raise ConfigError(
            f"{source}: {cue_map.time.unit!r} is no unit of time; hil knows {', '.join(TIME_UNITS)}"
        )
    for c in cue_map.channel:
        if c.unit not in _UNITS:
            raise ConfigError(
                f"{source}: {c.coordinate}: {c.unit!r} is no unit of a motion that hil knows: "
                f"{', '.join(_UNITS)}"
            )
        if c.coordinate not in _ALLOWED[c.kind]:
            article = "an" if c.kind[0] == "a" else "a"
            raise ConfigError(
                f"{source}: {c.column!r} in {c.unit} is {article} {c.kind}, which can become "
                f"{', '.join(_ALLOWED[c.kind])}, not {c.coordinate!r}"
            )
    return cue_map
