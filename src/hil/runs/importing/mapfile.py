"""The map of a foreign log: which of its columns is which signal of a run, in what unit, on what clock.

A signal's SI value is sign · factor(unit) · (scale · (raw − zero) · times / divided_by + offset + plus),
where `times` and `divided_by` name other columns or scalars of the file and `plus` adds further columns.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, field_validator, model_validator

from hil.config.base import Positive, Settings
from hil.configfile import data_folder, load_settings
from hil.errors import ConfigError
from hil.runs.folder import Instant, Mode, Payload
from hil.runs.importing.units import UNITS, unit_name

TimeUnit = Literal["s", "ms", "us", "ns", "samples", "datetime"]
Allowance = Literal["duplicate_stamps", "nan_block", "opposite_sign", "clock_span"]


class Clock(Settings):
    """The clock that stamped a column. Nothing at all: the stamps that the log gives each message."""

    column: str | None = Field(None, description="column, or message field, that holds the time")
    unit: TimeUnit = Field("s", description='unit of that column; "samples" counts at `rate`')
    rate: Positive | None = Field(
        None,
        description="samples a second: alone where no column holds the time; with a column the stamps, "
        "which must agree, are put on exact multiples of 1 / rate",
    )
    shift: float = Field(0.0, description="added to every stamp, s")

    @model_validator(mode="after")
    def _counts_need_a_rate(self) -> Clock:
        if self.unit == "samples" and (self.rate is None or self.column is None):
            raise ValueError('unit "samples" needs a column and a rate')
        return self


class Term(Settings):
    """A column with what makes it a quantity: scale · (raw − zero) · times / divided_by."""

    column: str = Field(description="column; MAT: variable; MCAP: topic:field; CAN: message.signal")
    scale: float = Field(1.0, description="factor, after which the value is in the signal's unit")
    zero: float = Field(0.0, description="raw value that stands for zero")
    times: tuple[str, ...] = Field((), description="columns or scalars of the file to multiply by")
    divided_by: tuple[str, ...] = Field((), description="columns or scalars to divide by")

    @field_validator("scale")
    @classmethod
    def _scale_is_not_zero(cls, value: float) -> float:
        if value == 0.0:
            raise ValueError("must not be 0")
        return value


class MappedSignal(Term):
    """One signal of the run."""

    unit: str = Field(description="what the number is after scale, times and divided_by")
    offset: float = Field(0.0, description="added after scale, in `unit`")
    sign: Literal[1, -1] = Field(1, description="-1 turns the signal round, the offset too")
    plus: tuple[Term, ...] = Field((), description="further columns that are added, in `unit`")
    time: Clock | None = Field(None, description="the signal's own clock, where it has one")

    @field_validator("unit")
    @classmethod
    def _unit_is_known(cls, value: str) -> str:
        name = unit_name(value)
        if name is None:
            raise ValueError(f"is no unit that hil knows: {', '.join(UNITS)}")
        return name


class FileSettings(Settings):
    """How the file is read, where hil should not find out by itself."""

    separator: Annotated[str, Field(min_length=1, max_length=1)] | None = Field(
        None,
        description='CSV: "," ";" "\\t" or " " for any white space; default: the first line tells',
    )
    header: bool | None = Field(None, description="CSV: whether the first line names the columns")
    names: tuple[str, ...] = Field(
        (), description='CSV without header: names of the columns; default "1", "2" ...'
    )
    comment: str = Field(
        "#", min_length=1, max_length=1, description="CSV: lines that begin with it are comments"
    )
    skip_rows: Annotated[int, Field(ge=0)] = Field(0, description="CSV: lines before all others")
    decimal: Literal[".", ","] = Field(".", description="CSV: decimal sign")
    encoding: str = Field("utf-8", description="CSV: character encoding")
    dbc: str | None = Field(None, description="CAN logs: the DBC, relative to the map")


class ImportMap(Settings):
    """A whole map file."""

    format: Literal["hil-map/1"] = "hil-map/1"
    rig: Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]*$")] = Field(description="the rig's name")
    mode: Mode = Field("position", description="what the drives were given; ride: a bicycle")
    started: Instant | None = Field(None, description="UTC; default: from the clock, if it tells")
    note: str = Field("", description="free text: where the log comes from")
    role: Literal["diagnose", "reference"] = "diagnose"
    payload: Payload | None = None
    file: FileSettings = FileSettings()
    time: Clock = Clock()
    signals: dict[str, MappedSignal] = Field(min_length=1, description="by the run's signal name")
    extra: dict[str, MappedSignal] = Field(
        {}, description="quantities that runs have no name for; kept in extra.parquet"
    )
    allow: tuple[Allowance, ...] = Field(
        (), description="faults that this log is known to have and is imported with"
    )


def find_map(name: str) -> Path:
    """The map called `name`: a path, or the bare name of one that comes with hil."""
    path = Path(name)
    if path.is_file():
        return path
    folder = data_folder("configs") / "maps"
    shipped = folder / f"{path.stem}.toml"
    if path.name in (path.stem, shipped.name) and len(path.parts) == 1 and shipped.is_file():
        return shipped
    known = ", ".join(sorted(p.stem for p in folder.glob("*.toml")))
    raise ConfigError(f"{name}: no such map; those that come with hil are {known}")


def load_map(path: Path) -> ImportMap:
    """Read and check a map file; ConfigError names file, key and what is wrong."""
    return load_settings(path, ImportMap)
