"""Numbers of a rig file by name: read, change, with units, bounds and the size at which they matter.

`mass.m`, `mass.cog.x`, `mass.inertia.xx`, `leg1.viscous`, `leg1.position_gain`, `bus.setpoint_delay`.
Group names change all actuators alike: `all.viscous` (one value for all), `all.force_gain` (factor on
every gain that makes force: K_p, K_d of the law "pd", the speed loop's gains of a cascade; K_c of
"Towards Simulating a Mid-size Stewart Platform on a Large Hexapod Simulator").

A number of the rig file means the plant AND what the drives were set to with it (gravity and friction
feed-forward). The effects of `hil.sim.parameters` ("platform.payload_mass.mass") mean the plant alone.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from hil.config import RigFile
from hil.errors import ConfigError

AXES: Final = {"x": 0, "y": 1, "z": 2}
FIELD_UNIT: Final = {
    "reflected_mass": "kg",
    "viscous": "N·s/m",
    "coulomb": "N",
    "position_gain": "1/s",
    "speed_gain": "N·s/m",
    "integral_gain": "N/m",
    "velocity_ff": "1",
    "acceleration_ff": "1",
    "friction_ff": "1",
    "static_ff": "1",
    "effective_mass": "kg",
    "current_hz": "Hz",
}
"""Fields of an actuator that can be named."""
DELAYS: Final = ("setpoint_delay", "answer_delay")
GROUP: Final = "all"
FORCE_GAIN: Final = "all.force_gain"


@dataclass(frozen=True, slots=True)
class Number:
    """One number of a rig file. `scale`: the size at which it matters, for steps and judgement."""

    name: str
    unit: str
    value: float
    lower: float
    upper: float
    scale: float


def number(rig: RigFile, name: str) -> Number:
    """The number `name` as `rig` has it; ConfigError with the nearest names if there is none."""
    value = _read(rig, name)
    head, _, field = name.partition(".")
    if head == "mass":
        if name == "mass.m":
            return Number(name, "kg", value, 0.02 * value, 50.0 * value, value)
        if field.startswith("cog"):
            return Number(name, "m", value, -2.0, 2.0, 0.1)
        size = float(np.trace(np.array(rig.mass.inertia))) / 3.0
        lower = 0.0 if name[-1] == name[-2] else -10.0 * size
        scale = value if name[-1] == name[-2] else size
        return Number(name, "kg·m²", value, lower, 50.0 * size, scale)
    if head == "bus":
        return Number(name, "s", value, 0.0, 0.1, 1e-3)
    if field == "force_gain":
        return Number(name, "1", value, 0.02, 50.0, 1.0)
    peak = max(a.force_max for a in rig.actuators)
    floor = {"viscous": 20.0, "coulomb": 0.002 * peak, "reflected_mass": 1.0}.get(field, 0.1)
    size = max(abs(value), floor)
    unit = FIELD_UNIT[field]
    if field == "position_gain" and all(a.law == "pd" for a in rig.actuators):
        unit = "N/m"
    return Number(name, unit, value, 0.0, 50.0 * size, size)


def is_rig_number(rig: RigFile, name: str) -> bool:
    """Whether `name` is a number of the rig file, and no effect of the model."""
    return name in _all(rig)


def with_numbers(rig: RigFile, values: Mapping[str, float]) -> RigFile:
    """`rig` with these numbers. Not validated: an estimator may stray where no file may."""
    cog, inertia = list(rig.mass.cog), [list(row) for row in rig.mass.inertia]
    mass: dict[str, Any] = {}
    actuators = {a.name: dict[str, float]() for a in rig.actuators}
    bus: dict[str, float] = {}
    for name, value in values.items():
        if name not in _all(rig):
            raise unknown(rig, name)
        head, _, field = name.partition(".")
        if name == "mass.m":
            mass["m"] = value
        elif field.startswith("cog."):
            cog[AXES[field[-1]]] = value
        elif head == "mass":
            i, j = AXES[field[-2]], AXES[field[-1]]
            inertia[i][j] = inertia[j][i] = value
        elif head == "bus":
            bus[field] = value
        else:
            for a in rig.actuators:
                if head not in (GROUP, a.name):
                    continue
                if name == FORCE_GAIN:
                    actuators[a.name].update({f: value * getattr(a, f) for f in force_gains(a.law)})
                else:
                    actuators[a.name][field] = value
    mass["cog"] = tuple(cog)
    mass["inertia"] = tuple(tuple(row) for row in inertia)
    return rig.model_copy(
        update={
            "mass": rig.mass.model_copy(update=mass),
            "bus": rig.bus.model_copy(update=bus),
            "actuators": tuple(a.model_copy(update=actuators[a.name]) for a in rig.actuators),
        }
    )


def force_gains(law: str) -> tuple[str, ...]:
    """Gains of a drive that turn motion into force, so that they scale as forces do."""
    return ("position_gain", "speed_gain") if law == "pd" else ("speed_gain", "integral_gain")


def _all(rig: RigFile) -> tuple[str, ...]:
    inertia = ("xx", "yy", "zz", "xy", "xz", "yz")
    return (
        "mass.m",
        *(f"mass.cog.{c}" for c in AXES),
        *(f"mass.inertia.{c}" for c in inertia),
        *(f"{a}.{f}" for a in (*rig.actuator_names, GROUP) for f in FIELD_UNIT),
        FORCE_GAIN,
        *(f"bus.{d}" for d in DELAYS),
    )


def _read(rig: RigFile, name: str) -> float:
    if name not in _all(rig):
        raise unknown(rig, name)
    head, _, field = name.partition(".")
    if name == "mass.m":
        return rig.mass.m
    if field.startswith("cog."):
        return rig.mass.cog[AXES[field[-1]]]
    if head == "mass":
        return rig.mass.inertia[AXES[field[-2]]][AXES[field[-1]]]
    if head == "bus":
        return float(getattr(rig.bus, field))
    if name == FORCE_GAIN:
        return 1.0
    values = [getattr(a, field) for a in rig.actuators if head in (GROUP, a.name)]
    return float(np.mean(values))


def unknown(rig: RigFile, name: str, more: Iterable[str] = ()) -> ConfigError:
    """The error for a name that neither the rig file nor `more` has."""
    near = difflib.get_close_matches(name, (*_all(rig), *more), 3)
    hint = f"; nearest: {', '.join(near)}" if near else ""
    return ConfigError(
        f"{rig.name}: {name!r} is nothing of its rig file or model that can be fitted{hint}"
    )
