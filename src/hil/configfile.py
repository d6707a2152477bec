"""Reads rig files: finds them, and turns what is wrong with them into sentences. Writes new ones."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any, TypeVar

import tomlkit
from pydantic import ValidationError

from hil.config import AnyRig, BicycleFile, RigFile
from hil.config.base import Settings
from hil.config.bicycle import BICYCLE
from hil.errors import ConfigError
from hil.files import write_whole

S = TypeVar("S", bound=Settings)


def data_folder(name: str) -> Path:
    """The folder `configs` or `drives` that comes with hil, installed or in a checkout."""
    installed = Path(__file__).parent / "_data" / name
    return installed if installed.is_dir() else Path(__file__).parents[2] / name


def find_rig_file(name: str) -> Path:
    """The rig file called `name`: a path, or the bare name of one that comes with hil."""
    path = Path(name)
    if path.is_file():
        return path
    shipped = data_folder("configs") / f"{path.stem}.toml"
    if path.name in (path.stem, shipped.name) and len(path.parts) == 1 and shipped.is_file():
        return shipped
    known = ", ".join(sorted(p.stem for p in data_folder("configs").glob("*.toml")))
    raise ConfigError(f"{name}: no such rig file; those that come with hil are {known}")


def load_rig(name: str | Path) -> RigFile:
    """Read and check the file of a rig that is driven; ConfigError names file, key and bound."""
    path = find_rig_file(str(name))
    tables = read_toml(path)
    if tables.get("kind") == BICYCLE:
        raise ConfigError(
            f"{path}: is a bicycle, which is ridden and not driven: see `hil bicycle`"
        )
    return parse_settings(tables, RigFile, str(path))


def load_bicycle(name: str | Path) -> BicycleFile:
    """Read and check a bicycle's rig file; ConfigError names file, key and bound."""
    path = find_rig_file(str(name))
    tables = read_toml(path)
    if tables.get("kind") != BICYCLE:
        raise ConfigError(f"{path}: is a {tables.get('kind')}, no {BICYCLE}")
    return parse_settings(tables, BicycleFile, str(path))


def load_any_rig(name: str | Path) -> AnyRig:
    """Read and check a rig file of either sort; ConfigError names file, key and bound."""
    path = find_rig_file(str(name))
    return parse_any_rig(read_toml(path), str(path))


def parse_any_rig(tables: dict[str, Any], source: str) -> AnyRig:
    """Check `tables` as a rig file of the sort that its kind says."""
    if tables.get("kind") == BICYCLE:
        return parse_settings(tables, BicycleFile, source)
    return parse_settings(tables, RigFile, source)


def load_drive(name: str, model: type[S]) -> S:
    """Read and check the drive file of the family `name`, a folder among those that come with hil."""
    return load_settings(data_folder("drives") / name / "drive.toml", model)


def rig_toml(rig: AnyRig, comment: str = "") -> str:
    """A rig file that says all of `rig`, defaults included, after a line of comment."""
    tables = rig.model_dump(mode="json", exclude_none=True)
    return (f"# {comment}\n" if comment else "") + tomlkit.dumps(tables)


def write_rig_file(path: Path, text: str) -> None:
    """Write a rig file whole or not at all; ConfigError where that fails or one stands there already."""
    if path.exists():
        raise ConfigError(f"{path}: exists already; name another file with --out")
    try:
        write_whole(path, text)
    except OSError as error:
        raise ConfigError(f"{path}: cannot be written: {error.strerror}") from error


def load_settings(path: Path, model: type[S]) -> S:
    """Read a TOML file into `model`; ConfigError names file, key and bound."""
    return parse_settings(read_toml(path), model, str(path))


def read_toml(path: Path) -> dict[str, Any]:
    """The tables of a TOML file; ConfigError where it cannot be read or is no TOML."""
    return parse_toml(toml_text(path), str(path))


def parse_toml(text: str | bytes, source: str) -> dict[str, Any]:
    """The tables of `text`, which stands in `source`; ConfigError where it is no TOML."""
    try:
        return tomllib.loads(text if isinstance(text, str) else text.decode())
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ConfigError(f"{source}: is no TOML: {error}") from error


def toml_text(path: Path) -> str:
    """The text of a TOML file, without the mark that editors on Windows begin it with; as `read_toml`."""
    try:
        return path.read_text(encoding="utf-8-sig")
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise ConfigError(f"{path}: is no TOML: {error}") from error


def parse_settings(tables: dict[str, Any], model: type[S], source: str) -> S:
    """Check `tables` against `model`; every fault becomes one line of the ConfigError."""
    try:
        return model.model_validate(tables)
    except ValidationError as error:
        faults = [dict(fault) for fault in error.errors()]
        told = [f for f in faults if not _follows(f, faults)]
        lines = [f"{source}: {_sentence(fault, tables)}" for fault in told]
        raise ConfigError("\n".join(lines)) from error


def _follows(fault: dict[str, Any], faults: list[dict[str, Any]]) -> bool:
    """Whether a list is too short only because entries of it have faults of their own."""
    place = fault["loc"]
    inside = [f for f in faults if f["loc"][: len(place)] == place and f["loc"] != place]
    return fault["type"] == "too_short" and bool(inside)


def _sentence(fault: dict[str, Any], tables: dict[str, Any]) -> str:
    key = _dotted(fault["loc"], tables)
    if fault["type"] == "extra_forbidden":
        return f"{key} is not a key that hil knows"
    if fault["type"] == "missing":
        return f"{key} is missing"
    text = str(fault["msg"]).removeprefix("Value error, ")
    text = text[0].lower() + text[1:]
    value = fault.get("input")
    shown = f" (got {value!r})" if isinstance(value, str | int | float | bool) else ""
    return f"{key}: {text}{shown}" if key else text


def _dotted(location: tuple[Any, ...], tables: Any) -> str:
    """`actuators[1] (leg2).viscous` from pydantic's location, dropping names of union members."""
    parts: list[str] = []
    here: Any = tables
    for item in location:
        if isinstance(item, int):
            here = here[item] if isinstance(here, list | tuple) and item < len(here) else None
            name = here.get("name") if isinstance(here, dict) else None
            parts[-1:] = [f"{parts[-1] if parts else ''}[{item}]" + (f" ({name})" if name else "")]
        elif isinstance(here, dict) and item not in here and item is not location[-1]:
            continue
        else:
            here = here.get(item) if isinstance(here, dict) else None
            parts.append(str(item))
    return ".".join(parts)
