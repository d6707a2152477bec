"""Shipped rig files with some keys changed, and the drive files that belong to them."""

from __future__ import annotations

from typing import Any

from hil.config import RigFile
from hil.configfile import load_drive, load_rig, parse_settings
from hil.drives.profile import LustProfile

PROFILE = "lust_cdd3000"


def variant(name: str, **tables: dict[str, Any]) -> RigFile:
    """The shipped rig file `name` with the given keys of the given tables changed, checked anew."""
    values = load_rig(name).model_dump()
    for table, changes in tables.items():
        values[table].update(changes)
    return parse_settings(values, RigFile, name)


def profiles(**tables: dict[str, Any]) -> dict[str, LustProfile]:
    """The shipped drive file, with the given keys of the given tables changed."""
    values = load_drive(PROFILE, LustProfile).model_dump()
    for table, changes in tables.items():
        values[table].update(changes)
    return {PROFILE: parse_settings(values, LustProfile, PROFILE)}
