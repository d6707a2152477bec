"""The parameter vector of a rig's model: every effect of the catalogue at every place, by name.

Names are `<location>.<effect>.<parameter>`: "leg1.backlash.gap", "leg3.base.geometry_error.x",
"imu.gyro_x.sensor_bias.offset", "platform.payload_mass.mass", "drives.clock_drift.rate".
"""

from __future__ import annotations

import difflib
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hil.config import Actuator, AnyRig, AxisGeometry, BicycleFile, Effect
from hil.config.bicycle import SIGNALS
from hil.errors import ConfigError
from hil.sim.catalogue import (
    ACTUATOR,
    BICYCLE,
    BUS,
    CLOCK,
    GEOMETRY,
    IMU_CHANNELS,
    LEAN_TORQUE,
    MISALIGNMENT,
    PLATFORM,
    QUANTITIES,
    QUANTITY_SCALE,
    QUANTITY_UNIT,
    REAR_WHEEL,
    SLIP,
    WHEEL,
    Effects,
    Search,
    Spec,
    Value,
    sensor_effects,
)
from hil.units import with_unit

Array = NDArray[np.float64]
REMOVABLE: Final = 0.9
"""Of a platform's mass."""
ROTARY_UNIT = {
    "m": "rad", "m/s": "rad/s", "N": "N·m", "N·s/m": "N·m·s/rad", "N/m": "N·m/rad", "kg": "kg·m²",
}  # fmt: skip


@dataclass(frozen=True, slots=True)
class Parameter:
    """One entry of the vector. Values in `unit`; `scale` is the size at which it matters, 0 of what is chosen
    and never fitted."""

    name: str
    location: str
    effect: str
    parameter: str
    unit: str
    neutral: float
    lower: float
    upper: float
    scale: float
    search: Search

    def to_search(self, value: float) -> float:
        """Coordinate in which the model depends smoothly on it: itself, or 1 / value."""
        return value if self.search == "linear" else 1.0 / value

    def from_search(self, z: float) -> float:
        """The value at search coordinate `z`."""
        if self.search == "linear":
            return z
        return 1.0 / z if z > 0.0 else math.inf

    @property
    def search_step(self) -> float:
        """Step for finite differences, in the search coordinate: a delay steps over one loop tick."""
        if self.unit == "s":
            return 1e-3
        return 0.1 * abs(self.to_search(self.scale))


class ParameterTable:
    """All parameters of a rig's model, in the order of the vector."""

    def __init__(self, rig: AnyRig) -> None:
        self.rig_name = rig.name
        self.entries: tuple[Parameter, ...] = _entries_of(rig)
        self._index = {p.name: i for i, p in enumerate(self.entries)}
        self.neutral: Array = np.array([p.neutral for p in self.entries])
        self.neutral.setflags(write=False)

    def __len__(self) -> int:
        return len(self.entries)

    def __getitem__(self, name: str) -> Parameter:
        return self.entries[self.index(name)]

    def index(self, name: str) -> int:
        """Place of the parameter `name` in the vector; ConfigError with the nearest names."""
        try:
            return self._index[name]
        except KeyError:
            near = difflib.get_close_matches(name, self._index, 3)
            hint = f"; nearest: {', '.join(near)}" if near else ""
            raise ConfigError(
                f"{self.rig_name}: no parameter {name!r} in its model{hint}"
            ) from None

    def vector(self, values: Mapping[str, float], base: Array | None = None) -> Array:
        """`base` (default: neutral) with `values` by name, each within its bounds."""
        out = np.array(self.neutral if base is None else base)
        for name, value in values.items():
            i = self.index(name)
            p = self.entries[i]
            if not p.lower <= value <= p.upper:
                raise ConfigError(
                    f"{self.rig_name}: {name} = {with_unit(f'{value:g}', p.unit)} lies outside "
                    f"{p.lower:g}..{p.upper:g}"
                )
            out[i] = value
        return out

    def from_effects(self, effects: Iterable[Effect]) -> Array:
        """The vector that the `effects` lines of a rig file stand for."""
        values: dict[str, float] = {}
        for line in effects:
            for parameter, value in line.parameters.items():
                name = f"{line.location}.{line.effect}.{parameter}"
                if name in values:
                    raise ConfigError(f"{self.rig_name}: effects: {name} is given twice")
                values[name] = value
        return self.vector(values)


def _entries_of(rig: AnyRig) -> tuple[Parameter, ...]:
    if isinstance(rig, BicycleFile):
        return tuple(_of_bicycle())
    has_joints = not isinstance(rig.geometry, AxisGeometry)
    return _rig_entries(rig.actuators, rig.mass.m, rig.is_rotary, has_joints)


@lru_cache(maxsize=32)
def _rig_entries(
    actuators: tuple[Actuator, ...], mass_kg: float, is_rotary: bool, has_joints: bool
) -> tuple[Parameter, ...]:
    """Those of one mechanism, whatever its drives wait for and its sensors have: a diagnosis asks for them
    hundreds of times."""
    return tuple(_entries(actuators, mass_kg, is_rotary, has_joints))


def _entries(
    actuators: Iterable[Actuator], mass_kg: float, is_rotary: bool, has_joints: bool
) -> Iterable[Parameter]:
    for a in actuators:
        units = ROTARY_UNIT if is_rotary else {}
        yield from _block(a.name, ACTUATOR, a, units)
        for quantity in QUANTITIES:
            effects = sensor_effects(QUANTITY_UNIT[quantity], QUANTITY_SCALE[quantity])
            yield from _block(f"{a.name}.{quantity}", effects, a, units)
    yield from _block("platform", _platform(mass_kg))
    for channel in IMU_CHANNELS:
        unit, scale = ("rad/s", 0.01) if channel.startswith("gyro") else ("m/s²", 0.05)
        yield from _block(f"imu.{channel}", sensor_effects(unit, scale))
    yield from _block("imu", sensor_effects("rad/s, m/s²", 0.01) | MISALIGNMENT)
    yield from _block("imu", CLOCK)
    yield from _block("drives", CLOCK)
    yield from _block("bus", BUS)
    if has_joints:
        for a in actuators:
            for end in ("base", "platform"):
                yield from _block(f"{a.name}.{end}", GEOMETRY)


def _platform(mass_kg: float) -> Effects:
    """Effects of a platform from which nobody can take more than it weighs."""
    (mass,) = PLATFORM["payload_mass"]
    return PLATFORM | {"payload_mass": (replace(mass, lower=-REMOVABLE * mass_kg),)}


def _of_bicycle() -> Iterable[Parameter]:
    yield from _block("bicycle", BICYCLE)
    yield from _block("bicycle.lean_torque", LEAN_TORQUE)
    yield from _block("rear_wheel", REAR_WHEEL | SLIP)
    yield from _block("front_wheel", WHEEL)
    for signal in SIGNALS:
        yield from _block(signal, sensor_effects("rad", 0.01))
    for channel in IMU_CHANNELS:
        unit, scale = ("rad/s", 0.01) if channel.startswith("gyro") else ("m/s²", 0.05)
        yield from _block(f"imu.{channel}", sensor_effects(unit, scale))
    yield from _block("imu", sensor_effects("rad/s, m/s²", 0.01) | MISALIGNMENT | CLOCK)


def _block(
    location: str,
    effects: Effects,
    actuator: Actuator | None = None,
    units: Mapping[str, str] | None = None,
) -> Iterable[Parameter]:
    for effect, specs in effects.items():
        for s in specs:
            yield Parameter(
                name=f"{location}.{effect}.{s.parameter}",
                location=location,
                effect=effect,
                parameter=s.parameter,
                unit=(units or {}).get(s.unit, s.unit),
                neutral=_value(s.neutral, actuator),
                lower=_value(s.lower, actuator),
                upper=_value(s.upper, actuator),
                scale=_value(s.scale, actuator),
                search=s.search,
            )


def _value(value: Value, actuator: Actuator | None) -> float:
    if isinstance(value, int | float):
        return float(value)
    if actuator is None:
        raise ValueError("a value that depends on the actuator stands where there is none")
    return float(value(actuator))


__all__ = ["Parameter", "ParameterTable", "Spec"]
