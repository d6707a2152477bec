"""Units in words: which that of a quantity is, and how one stands behind a number ("1" is none)."""

from __future__ import annotations

from typing import Final

_UNITS: Final = {
    "position": ("m", "rad"),
    "velocity": ("m/s", "rad/s"),
    "force": ("N", "N·m"),
    "setpoint": ("m", "rad"),
    "current": ("A", "A"),
    "gyro": ("rad/s", "rad/s"),
    "accel": ("m/s²", "m/s²"),
}
"""By the first word of a quantity: of an actuator that pushes, of one that turns."""


def quantity_unit(quantity: str, *, is_rotary: bool = False) -> str:
    """SI unit of what an actuator (`is_rotary`: one that turns) or an IMU measures, or an actuator is told.

    `quantity` as in a signal's name: "force", "force_setpoint", "gyro_x".
    """
    return _UNITS[quantity.partition("_")[0]][is_rotary]


def with_unit(number: str, unit: str) -> str:
    """A number, already in words, and its unit, which what has no dimension has not."""
    return number if unit in ("", "1") else f"{number} {unit}"
