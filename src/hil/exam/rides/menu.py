"""Catalogue effects that a ride may have: places and other numbers drawn, one size left open.

The smallest sizes are those that no calibration sets right: twice what `hil.gap.bicycle.leaves` lets a
nuisance be.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final

import numpy as np

from hil.exam.actuator_menu import sign
from hil.exam.menu import Recipe

Rng = np.random.Generator

CHANNELS: Final = (*(f"imu.gyro_{a}" for a in "xyz"), *(f"imu.accel_{a}" for a in "xyz"))


def _fork(rng: Rng) -> Recipe:
    share = rng.uniform(0.15, 0.5)

    def make(s: float) -> dict[str, float]:
        k = 1e4 / s
        return {"stiffness": k, "damping": 2.0 * share * math.sqrt(k * 30.0)}

    return Recipe("front_suspension", "bicycle", make, 0.5, 5.0, 0.06)


def _tyres(rng: Rng) -> Recipe:
    share = rng.uniform(0.03, 0.1)

    def make(s: float) -> dict[str, float]:
        k = 1e5 / s
        return {"stiffness": k, "damping": 2.0 * share * math.sqrt(k * 45.0)}

    return Recipe("tyre_compliance", "bicycle", make, 1.0, 3.5, 0.25)


def _radius(rng: Rng) -> Recipe:
    way = sign(rng)
    at = "rear_wheel" if rng.random() < 0.75 else "front_wheel"
    return Recipe(
        "wheel_radius", at, lambda s: {"scale": math.exp(way * s)}, 0.02, 0.15, 0.008
    )  # fmt: skip


def _slip(rng: Rng) -> Recipe:
    return Recipe("wheel_slip", "rear_wheel", lambda s: {"coefficient": s}, 0.02, 0.15, 0.008)


def _rider(rng: Rng) -> Recipe:
    if rng.random() < 0.7:
        way = sign(rng)
        return Recipe("rider_motion", "bicycle", lambda s: {"gain": way * s}, 0.2, 0.9, 0.03)
    damping = rng.uniform(60.0, 140.0)
    return Recipe(
        "rider_motion", "bicycle",
        lambda s: {"stiffness": 1500.0 / s, "damping": damping}, 1.0, 5.0, 0.05,
    )  # fmt: skip


def _bias(rng: Rng) -> Recipe:
    at = str(rng.choice(["lean", "steer", *CHANNELS]))
    way = sign(rng)
    if at in ("lean", "steer"):
        return Recipe(
            "sensor_bias", at, lambda s: {"offset": way * s}, 0.02, 0.2, 0.009 if at == "lean" else 0.006
        )  # fmt: skip
    unit = 0.004 if "gyro" in at else 0.08
    return Recipe(
        "sensor_bias", at, lambda s: {"offset": way * s}, 2.0 * unit, 40.0 * unit, 1.2 * unit
    )  # fmt: skip


def _scale(rng: Rng) -> Recipe:
    at = str(rng.choice(["lean", "steer", "rear_wheel", *CHANNELS]))
    way = sign(rng)
    return Recipe("sensor_scale", at, lambda s: {"scale": math.exp(way * s)}, 0.05, 0.5, 0.01)


def _latency(rng: Rng) -> Recipe:
    at = str(rng.choice(["lean", "steer", "rear_wheel", "imu"]))
    return Recipe("sensor_latency", at, lambda s: {"delay": s}, 0.03, 0.2, 0.005)


def _turned(rng: Rng) -> Recipe:
    axis = rng.standard_normal(3)
    axis /= np.linalg.norm(axis)
    return Recipe(
        "sensor_misalignment", "imu",
        lambda s: {c: float(s * x) for c, x in zip("xyz", axis, strict=True)}, 0.03, 0.4, 0.02,
    )  # fmt: skip


def _clock(rng: Rng) -> Recipe:
    way = sign(rng)
    return Recipe("clock_drift", "imu", lambda s: {"rate": way * s}, 1e-3, 9e-3, 3e-4)


EFFECTS: Final[dict[str, Callable[[Rng], Recipe]]] = {
    "front_suspension": _fork,
    "tyre_compliance": _tyres,
    "wheel_radius": _radius,
    "wheel_slip": _slip,
    "rider_motion": _rider,
    "sensor_bias": _bias,
    "sensor_scale": _scale,
    "sensor_latency": _latency,
    "sensor_misalignment": _turned,
    "clock_drift": _clock,
}
RIDE_EFFECTS: Final = tuple(EFFECTS)


def draw_effect(name: str, rng: Rng) -> Recipe:
    """Place and numbers of a catalogue effect, its size left open."""
    return EFFECTS[name](rng)
