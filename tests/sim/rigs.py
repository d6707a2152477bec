"""Rigs as the tests of the simulation want them: without friction, with other gains, loads, effects."""

from __future__ import annotations

from typing import Any

from hil.config import RigFile
from hil.configfile import load_rig

FRICTIONLESS = {"coulomb": 0.0, "viscous": 0.0}


def changed(rig: RigFile, actuator: dict[str, Any] | None = None, **tables: Any) -> RigFile:
    """`rig` with these keys of every actuator and these of other tables (a dict merges) replaced."""
    data = rig.model_dump()
    for row in data["actuators"]:
        row.update(actuator or {})
    for key, value in tables.items():
        data[key] = {**data[key], **value} if isinstance(value, dict) else value
    return RigFile.model_validate(data)


def frictionless(name: str, **actuator: Any) -> RigFile:
    """A shipped rig without friction."""
    return changed(load_rig(name), {**FRICTIONLESS, **actuator})


def pendulum(**actuator: Any) -> RigFile:
    """The axis bench turning a load that hangs 0.3 m below its axis of rotation."""
    wide = {"stroke": (-3.0, 3.0), "velocity_max": 20.0, **actuator}
    return changed(
        load_rig("axis"),
        wide,
        geometry={"load": "pendulum"},
        mass={"m": 20.0, "cog": (0.0, 0.0, -0.3)},
        limits=(1.5,),
    )


def effect(name: str, location: str, **parameters: float) -> dict[str, Any]:
    """One line of a rig file's `effects`."""
    return {"effect": name, "location": location, "parameters": parameters}


def with_effects(rig: RigFile, *lines: dict[str, Any]) -> RigFile:
    """`rig` with these effects switched on."""
    return changed(rig, effects=lines)
