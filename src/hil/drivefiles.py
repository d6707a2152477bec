"""Reads drive files: drive.toml by its protocol, and with CANopen the EDS beside it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from hil.config import RigFile
from hil.configfile import data_folder, parse_settings, read_toml
from hil.drives.cia402.objects import ObjectDictionary, ObjectEntry
from hil.drives.cia402.profile import Cia402Profile
from hil.drives.profile import LustProfile
from hil.drives.profiles import DriveProfile
from hil.errors import ConfigError


def profile_folder(name: str) -> Path:
    """The folder of the family `name`, which is one below drives/ or a path."""
    return Path(name) if Path(name).is_dir() else data_folder("drives") / name


def find_drive_file(name: str) -> Path:
    """The drive file of the family `name`; ConfigError where there is none."""
    path = profile_folder(name) / "drive.toml"
    if not path.is_file():
        known = ", ".join(sorted(p.parent.name for p in data_folder("drives").glob("*/drive.toml")))
        raise ConfigError(f"{name}: no such drive file; those that come with hil are {known}")
    return path


def load_profile(name: str) -> DriveProfile:
    """The drive file of the family `name`, a folder below drives/ or a path to one; or ConfigError."""
    path = find_drive_file(name)
    tables = read_toml(path)
    if tables.get("protocol") != "canopen":
        return parse_settings(tables, LustProfile, str(path))
    profile = parse_settings(tables, Cia402Profile, str(path))
    return profile.with_objects(load_eds(path.parent / profile.eds))


def load_profiles(rig: RigFile, source: str = "") -> dict[str, DriveProfile]:
    """The drive files that a rig names, by name.

    ConfigError names `source` (the rig file; by default the rig's name) and the key of each that is missing.
    """
    faults = []
    for k, actuator in enumerate(rig.actuators):
        try:
            find_drive_file(actuator.drive.profile)
        except ConfigError as error:
            faults.append(
                f"{source or rig.name}: actuators[{k}] ({actuator.name}).drive.profile: {error}"
            )
    if faults:
        raise ConfigError("\n".join(faults))
    return {name: load_profile(name) for name in sorted({a.drive.profile for a in rig.actuators})}


def load_eds(path: Path) -> ObjectDictionary:
    """The objects of an EDS (or DCF); ConfigError where it is none."""
    from canopen import objectdictionary as od  # 0.1 s, and only rigs with such drives need it

    if not path.is_file():
        raise ConfigError(f"{path}: there is no EDS; the drive's maker has one, put it there")
    try:
        found = od.import_od(str(path), node_id=0)  # $NODEID counts from 0: relative
    except Exception as error:  # whatever the parser makes of a wrong file
        raise ConfigError(f"{path}: cannot be read as an EDS: {error}") from error
    entries: dict[tuple[int, int], ObjectEntry] = {}
    for thing in found.values():
        variables = [thing] if isinstance(thing, od.ODVariable) else list(thing.values())
        for v in variables:
            entries[v.index, v.subindex] = _entry(v)
    if not entries:
        raise ConfigError(f"{path}: holds no object: is it an EDS?")
    device = found.device_information
    return ObjectDictionary(
        entries,
        vendor=device.vendor_number,
        product=device.product_number,
        revision=device.revision_number,
        source=str(path),
    )


def _entry(v: Any) -> ObjectEntry:
    return ObjectEntry(
        v.index,
        v.subindex,
        v.name,
        int(v.data_type or 0),
        str(v.access_type).lower(),
        v.default,
        v.min,
        v.max,
        bool(v.relative),
    )
