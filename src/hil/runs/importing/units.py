"""Units that a map may name: what each measures and its factor to SI. Angles are rad, forces N or N·m."""

from __future__ import annotations

import math
from typing import Final

from hil.config import RigFile

_DEGREE: Final = math.pi / 180.0

UNITS: Final[dict[str, tuple[str, float]]] = {
    "m": ("length", 1.0),
    "cm": ("length", 1e-2),
    "mm": ("length", 1e-3),
    "um": ("length", 1e-6),
    "in": ("length", 0.0254),
    "rad": ("angle", 1.0),
    "mrad": ("angle", 1e-3),
    "deg": ("angle", _DEGREE),
    "rev": ("angle", 2.0 * math.pi),
    "m/s": ("speed", 1.0),
    "mm/s": ("speed", 1e-3),
    "km/h": ("speed", 1.0 / 3.6),
    "rad/s": ("angular rate", 1.0),
    "deg/s": ("angular rate", _DEGREE),
    "rpm": ("angular rate", 2.0 * math.pi / 60.0),
    "N": ("force", 1.0),
    "kN": ("force", 1e3),
    "N.m": ("torque", 1.0),
    "mN.m": ("torque", 1e-3),
    "A": ("current", 1.0),
    "mA": ("current", 1e-3),
    "V": ("voltage", 1.0),
    "m/s2": ("acceleration", 1.0),
    "g": ("acceleration", 9.80665),
    "1": ("number", 1.0),
}
"""By name: kind of quantity, and factor to SI."""

SI: Final = {
    "length": "m",
    "angle": "rad",
    "speed": "m/s",
    "angular rate": "rad/s",
    "force": "N",
    "torque": "N.m",
    "current": "A",
    "voltage": "V",
    "acceleration": "m/s2",
    "number": "1",
}
"""Kind of quantity to the unit in which a run keeps it."""

_SPELLINGS: Final = {
    "°": "deg",
    "degree": "deg",
    "degrees": "deg",
    "°/s": "deg/s",
    "dps": "deg/s",
    "µm": "um",
    "μm": "um",
    "Nm": "N.m",
    "N·m": "N.m",
    "N*m": "N.m",
    "mNm": "mN.m",
    "mN·m": "mN.m",
    "m/s^2": "m/s2",
    "m/s²": "m/s2",
    "m/s/s": "m/s2",
    "1/min": "rpm",
    "kph": "km/h",
}
_TRANSLATIONS: Final = ("surge", "sway", "heave")
_ROTATIONS: Final = ("yaw", "pitch", "roll")
_LINEAR: Final = {
    "setpoint": "length",
    "position": "length",
    "velocity": "speed",
    "force": "force",
    "force_setpoint": "force",
}
_ROTARY: Final = {"length": "angle", "speed": "angular rate", "force": "torque"}


def unit_name(text: str) -> str | None:
    """The table's name of the unit written as `text`, or None where it is none that hil knows."""
    name = _SPELLINGS.get(text.strip(), text.strip())
    return name if name in UNITS else None


def kinds_of(signal: str, rig: RigFile | None) -> tuple[str, ...]:
    """Kinds of quantity that `signal` of a run may be; a rotary drive has rad and N·m where others m and N.

    Without a rig file both may be.
    """
    group, _, quantity = signal.partition(".")
    if group == "imu":
        return ("angular rate",) if quantity.startswith("gyro") else ("acceleration",)
    if not quantity or quantity in _ROTATIONS:
        return ("angle",)
    if quantity in _TRANSLATIONS:
        return ("length",)
    if quantity == "current":
        return ("current",)
    linear = _LINEAR["position" if group == "cue" else quantity]
    if rig is None:
        return (linear, _ROTARY[linear])
    return (_ROTARY[linear],) if rig.is_rotary else (linear,)
