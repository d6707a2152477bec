"""Options that several commands share, and the rig file with them applied."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import typer

from hil.config import RigFile
from hil.configfile import find_rig_file, load_rig, parse_settings, rig_toml
from hil.drivefiles import load_profiles
from hil.drives.profiles import DriveProfile
from hil.effectlines import checked


class ModeName(StrEnum):
    """Control modes, for the command line."""

    drive = "drive"
    cascade = "cascade"
    computed_torque = "computed_torque"


CanOption = Annotated[
    str | None,
    typer.Option(
        "--can",
        help="Bus instead of the rig file's: socketcan:can0, hub:SOCKET_PATH, python-can:INTERFACE:CHANNEL; "
        "for a rig with several buses one each, with commas between.",
    ),
]
ModeOption = Annotated[
    ModeName | None, typer.Option("--mode", help="Control mode instead of the rig file's.")
]
ListenOption = Annotated[
    str | None, typer.Option("--listen", help="Zenoh endpoint instead of the rig file's.")
]
RunsOption = Annotated[
    Path | None, typer.Option("--runs", help="Folder for recordings instead of the rig file's.")
]
SeedOption = Annotated[int, typer.Option("--seed", help="Seed of noise and jitter.", min=0)]

PATIENCE_S = 0.5
"""So long a simulated rig may stand still: a desk computer without real-time rights does, now and then."""


def rig_with(
    name: str,
    *,
    can: str | None = None,
    mode: ModeName | None = None,
    listen: str | None = None,
    runs: Path | None = None,
    patient: bool = False,
) -> tuple[RigFile, str]:
    """The rig file `name` with what the command line says instead, and the text of that.

    `patient` is for simulated rigs in real time: silence up to `PATIENCE_S` is no fault.
    """
    rig = checked(load_rig(name), name)
    tables: dict[str, Any] = rig.model_dump()
    if can is not None:
        put_buses(tables["can"], can)
    if mode is not None:
        tables["control"]["mode"] = mode.value
    if listen is not None:
        tables["zenoh"]["listen"] = (listen,)
    if runs is not None:
        tables["recording"]["folder"] = str(runs)
    if patient:
        make_patient(tables)
    resolved = parse_settings(tables, RigFile, name)
    return resolved, rig_toml(resolved, f"{find_rig_file(name)} with every default filled in")


def make_patient(tables: dict[str, Any]) -> None:
    """Let a rig file's tables wait `PATIENCE_S` for drives and cues, and miss as many cycles."""
    cycles = min(100, round(PATIENCE_S / tables["bus"]["cycle"]))
    waits = {"answer_timeout": PATIENCE_S, "drive_watchdog": PATIENCE_S, "overrun_cycles": cycles}
    for key, patience in waits.items():
        tables["safety"][key] = max(tables["safety"][key], patience)
    tables["cue"]["stale"] = max(tables["cue"]["stale"], PATIENCE_S)


def put_buses(table: dict[str, Any], urls: str) -> None:
    """Put the buses of `urls`, separated by commas, into a rig file's table `can`."""
    further = [dict(bus) for bus in table.get("further", ())]
    given = urls.split(",")
    if len(given) != 1 + len(further):
        raise typer.BadParameter(
            f"this rig has {1 + len(further)} buses, so --can takes as many, with commas between, not "
            f"{len(given)}"
        )
    table["url"] = given[0]
    for bus, url in zip(further, given[1:], strict=True):
        bus["url"] = url
    table["further"] = tuple(further)


def profiles_of(rig: RigFile, name: str | None = None) -> dict[str, DriveProfile]:
    """The drive files that a rig names; ConfigError says which key names one that is missing."""
    return load_profiles(rig, "" if name is None else str(find_rig_file(name)))
