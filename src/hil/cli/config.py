"""`hil config`: check a rig file, show it resolved, print its JSON schema."""

from __future__ import annotations

from typing import Annotated

import typer
from rich.table import Table

from hil.bus.schedule import require_schedule_fits
from hil.cli.console import JsonFlag, RigArgument, complain, out, write_json
from hil.config import BicycleFile, RigFile
from hil.config.base import Settings
from hil.config.sizes import odd_sizes
from hil.configfile import find_rig_file, load_any_rig
from hil.drivefiles import load_profiles
from hil.effectlines import checked
from hil.errors import ConfigError
from hil.rigs import build_rig

app = typer.Typer(help="Rig files: everything about a rig in one TOML file.", no_args_is_help=True)


@app.command()
def check(rig: RigArgument, json: JsonFlag = False) -> None:
    """Read a rig file and say what is wrong with it, or that nothing is.

    Exit code 1 if it is wrong, 2 if there is no such file.
    """
    path = find_rig_file(rig)
    try:
        loaded = checked(load_any_rig(rig), rig)
        doubts = _bicycle(loaded) if isinstance(loaded, BicycleFile) else _driven(loaded, str(path))
    except ConfigError as error:
        if json:
            write_json({"ok": False, "faults": str(error).splitlines()})
        else:
            complain(str(error))
        raise typer.Exit(1) from error
    warnings = [f"{path}: {sentence}" for sentence in doubts]
    if json:
        answer = {"ok": True, "name": loaded.name, "kind": loaded.kind, "warnings": warnings}
        write_json(answer)
    else:
        for text in warnings:
            out.print(f"warning: {text}", style="yellow", soft_wrap=True)
        count = len(loaded.actuators)
        has = f" with {count} actuator{'s' if count > 1 else ''}" if count else ""
        out.print(f"{path}: {loaded.name} is a {loaded.kind}{has}; no fault found")


@app.command()
def show(rig: RigArgument, json: JsonFlag = False) -> None:
    """Show every setting of a rig with its value, defaults filled in, and what it means."""
    loaded = load_any_rig(rig)
    if json:
        write_json(loaded.model_dump(mode="json"))
        return
    table = Table("key", "value", "meaning", title=f"{loaded.name} ({loaded.kind})")
    for key, value, meaning in _rows(loaded, ""):
        table.add_row(key, value, meaning)
    out.print(table)


@app.command()
def schema(
    rig: Annotated[
        str | None,
        typer.Argument(metavar="[RIG]", help="Narrow the schema to the kind of this rig file."),
    ] = None,
) -> None:
    """Print the JSON schema of rig files, for editors that complete and check TOML."""
    loaded = None if rig is None else load_any_rig(rig)
    described = (RigFile if loaded is None else type(loaded)).model_json_schema()
    if isinstance(loaded, RigFile):
        geometry = type(loaded.geometry).__name__
        described["properties"]["kind"] = {"const": loaded.kind}
        described["properties"]["geometry"] = {"$ref": f"#/$defs/{geometry}"}
    write_json(described)


def _driven(rig: RigFile, source: str) -> list[str]:
    """What is doubtful about the file of a rig that is driven; HilError for what is wrong."""
    build_rig(rig)
    require_schedule_fits(rig, load_profiles(rig, source))
    return odd_sizes(rig)


def _bicycle(rig: BicycleFile) -> list[str]:
    from hil.rigs.bicycle import impossible_bodies

    return impossible_bodies(rig)


def _rows(model: Settings, prefix: str) -> list[tuple[str, str, str]]:
    rows: list[tuple[str, str, str]] = []
    for name, field in type(model).model_fields.items():
        if field.exclude:
            continue
        value, key = getattr(model, name), f"{prefix}{name}"
        if isinstance(value, Settings):
            rows += _rows(value, f"{key}.")
        elif isinstance(value, tuple) and value and isinstance(value[0], Settings):
            for index, item in enumerate(value):
                rows += _rows(item, f"{key}[{getattr(item, 'name', index)}].")
        else:
            rows.append((key, _plain(value), field.description or ""))
    return rows


def _plain(value: object) -> str:
    if isinstance(value, tuple):
        return "[" + ", ".join(_plain(v) for v in value) + "]"
    return "–" if value is None else str(value)
