"""What an experiment was, as `experiment.toml`: its plan, its design, and when it was played.

With the plan and the rig file the design can be made again, of a custom motion with `custom.csv`, a copy of
the file it came from; `experiment.csv` beside it keeps the motion itself, so that nobody has to.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Literal, NamedTuple

import tomlkit
from pydantic import Field

from hil.config.base import Settings
from hil.configfile import parse_settings, read_toml
from hil.control.trajectory import CueTrajectory
from hil.errors import ConfigError, RunError
from hil.identify.experiments.custom import keep_custom
from hil.identify.experiments.plans import Custom, Plan
from hil.runs.cuefile import write_cue_file
from hil.runs.folder import EXPERIMENT_CSV, EXPERIMENT_TOML, Payload


class Segment(Settings):
    """A part of the motion that means something, s from the first row of `experiment.csv`."""

    name: str
    start_s: float
    end_s: float
    periods: int = Field(0, description="whole periods that fill it; 0: not periodic")
    realisation: int = Field(0, description="which draw of random phases, from 0")


class Lines(Settings):
    """Multiples of 1/period that a coordinate of a multisine moves with."""

    coordinate: str
    excited: tuple[int, ...]


class Played(Settings):
    """Where and when it ran."""

    on: Literal["simulated", "rig"]
    start_s: float = Field(
        description="instant of the motion's first row as `t` of the run's table has it, s"
    )
    endpoint: str = ""
    seed: int | None = Field(None, description="of the simulated rig's noise and jitter")
    effects: tuple[str, ...] = Field(
        (), description="that the simulated rig had besides its file's"
    )


class Description(Settings):
    """`experiment.toml`."""

    format: Literal["hil-experiment/1"] = "hil-experiment/1"
    rig: str = Field(description="name of the rig that it was designed for")
    hil: str = Field("", description="version of hil that designed it")
    purpose: str = Field("", description="what it is to tell, where `hil gap next` designed it")
    payload: Payload | None = Field(
        None, description="to be weighed and bolted on for a second play of the same motion"
    )
    plan: Annotated[Plan, Field(discriminator="kind")]
    coordinates: tuple[str, ...] = Field(description="that move")
    amplitude: tuple[float, ...] = Field(
        description="of each, as designed, in the plan's sense: m, rad, m/s² or rad/s²"
    )
    scale: float = Field(description="of what was asked for; 1 where nothing had to give way")
    scaled_because: str = ""
    rate_hz: float
    duration_s: float
    period_s: float = Field(0.0, description="0: not periodic")
    lines: tuple[Lines, ...] = ()
    detection: tuple[int, ...] = Field(
        (), description="multiples of 1/period within the band that no coordinate moves with"
    )
    segments: tuple[Segment, ...] = ()
    played: Played | None = None


class Period(NamedTuple):
    """One period to measure: bounds in s, as `t` of the run's table, and its realisation."""

    start_s: float
    end_s: float
    realisation: int


def periods(description: Description) -> Iterator[Period]:
    """Every period for measuring of a periodic experiment that was played, in order of time."""
    start_s = description.played.start_s if description.played else 0.0
    for segment in description.segments:
        for k in range(segment.periods):
            at_s = start_s + segment.start_s + k * description.period_s
            yield Period(at_s, at_s + description.period_s, segment.realisation)


def write_experiment(folder: Path, description: Description, trajectory: CueTrajectory) -> None:
    """Write `experiment.toml` and `experiment.csv` into `folder`; RunError if the disk refuses.

    The file of a custom motion is copied there, too.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if isinstance(description.plan, Custom):
            plan = keep_custom(description.plan, folder)
            description = description.model_copy(update={"plan": plan})
        text = tomlkit.dumps(description.model_dump(mode="json", exclude_none=True))
        (folder / EXPERIMENT_TOML).write_text(text, encoding="utf-8")
    except OSError as error:
        raise RunError(f"{folder}: cannot be written: {error.strerror}") from error
    note = f"{description.plan.kind} designed by hil {description.hil}, see {EXPERIMENT_TOML}"
    write_cue_file(folder / EXPERIMENT_CSV, trajectory, description.rig, [note])


def experiment_of(folder: str | Path) -> Description | None:
    """The description kept in a run folder, None where the run was no experiment.

    RunError names file, key and bound where it is damaged.
    """
    path = Path(folder) / EXPERIMENT_TOML
    return read_experiment(path) if path.is_file() else None


def read_experiment(path: Path) -> Description:
    """A description by its file; the files that its plan names lie beside it.

    RunError names file, key and bound where it is damaged.
    """
    try:
        return parse_settings(read_toml(path), Description, str(path))
    except ConfigError as error:
        raise RunError(str(error)) from error
