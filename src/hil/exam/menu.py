"""What a case may have: catalogue effects of a rig, each with one size that is then solved for.

A `Recipe` turns a size (0: nothing) into parameters; all its other numbers are drawn once.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from hil.config import Actuator, AxisGeometry, MotorcycleGeometry, RigFile
from hil.exam.actuator_menu import ACTUATOR, Make, sign
from hil.runs.folder import run_mode

OF_LOOPS: Final = ("loop_gain", "velocity_saturation", "static_force_feedback")
"""What only drives have that close a loop."""


@dataclass(frozen=True, slots=True)
class Recipe:
    """An effect at a place; `parameters(size)`, first guess, largest sane size, and the smallest that is no
    matter of calibration: below it an effect lies within what a healthy rig is off its file anyway."""

    effect: str
    location: str
    parameters: Make
    guess: float
    largest: float
    smallest: float = 0.0
    is_outside: bool = False


def effects_of(rig: RigFile, signals: set[str]) -> tuple[str, ...]:
    """Catalogue effects that this rig with these recorded quantities can have and show."""
    load = rig.geometry.load if isinstance(rig.geometry, AxisGeometry) else "platform"
    axis = isinstance(rig.geometry, AxisGeometry)
    names = [
        "coulomb_friction", "viscous_friction", "stribeck_friction", "asymmetric_friction", "load_friction",
        "backlash", "hysteresis", "compliance", "actuator_inertia", "force_saturation",
        "velocity_saturation", "force_ripple", "force_constant", "loop_gain", "transport_delay",
        "lead_error", "payload_mass", "sensor_bias", "sensor_scale", "sensor_latency",
        "sensor_quantisation", "clock_drift", "lost_frames",
    ]  # fmt: skip
    if not axis or load == "pendulum":
        names += ["position_offset", "payload_cog", "payload_inertia"]
    if load != "vertical":
        names.append("base_tilt")
    if not axis:
        names.append("geometry_error")
    if any(a.law == "pd" for a in rig.actuators):
        names.append("static_force_feedback")
        names.remove("velocity_saturation")
    if "imu" in signals:
        names.append("sensor_misalignment")
    if run_mode(rig) == "force":
        names = [n for n in names if n not in OF_LOOPS]
    return tuple(names)


def possible(rig: str, mode: str = "position") -> tuple[str, ...]:
    """Every effect that some rig of the family `rig` can have in a mode."""
    names = [
        *ACTUATOR,
        "payload_mass",
        "payload_cog",
        "payload_inertia",
        "base_tilt",
        "clock_drift",
    ]
    names += ["sensor_bias", "sensor_scale", "sensor_latency", "sensor_quantisation"]
    names += ["sensor_misalignment", "lost_frames"]
    if rig != "axis":
        names.append("geometry_error")
    if rig == "stewart":
        names.append("static_force_feedback")
    return tuple(n for n in names if mode == "position" or n not in OF_LOOPS)


def draw_recipe(rig: RigFile, effect: str, signals: set[str], rng: np.random.Generator) -> Recipe:
    """Place and numbers of a catalogue `effect`; `signals`: recorded quantities, "imu" among them."""
    a = rig.actuators[rng.integers(len(rig.actuators))]
    make = ACTUATOR.get(effect)
    if make is not None:
        return Recipe(effect, a.name, *make(a, rng))
    if effect.startswith("sensor_"):
        return _sensor(rig, a, effect, signals, rng)
    if effect == "clock_drift":
        where = "imu" if "imu" in signals and rng.random() < 0.4 else "drives"
        way = sign(rng)
        return Recipe(effect, where, lambda s: {"rate": way * s}, 3e-4, 0.01, 6e-5)
    if effect == "lost_frames":
        return Recipe(effect, "bus", lambda s: {"setpoints": min(s, 0.6)}, 0.05, 0.4, 0.004)
    if effect == "geometry_error":
        return _geometry(rig, a, rng)
    return _platform(rig, effect, rng)


def _sensor(
    rig: RigFile, a: Actuator, effect: str, signals: set[str], rng: np.random.Generator
) -> Recipe:
    answered = sorted(s for s in signals if s != "imu")
    quantity = str(rng.choice(answered))
    place, noise = f"{a.name}.{quantity}", float(getattr(rig.noise, quantity))
    imu = "imu" in signals and rng.random() < 0.35
    if effect == "sensor_misalignment":
        axis = rng.standard_normal(3)
        axis /= np.linalg.norm(axis)
        return Recipe(
            effect,
            "imu",
            lambda s: {c: float(s * x) for c, x in zip("xyz", axis, strict=True)},
            0.02,
            0.4,
            0.01,
        )
    if imu:
        channel = f"{rng.choice(['gyro', 'accel'])}_{rng.choice(list('xyz'))}"
        place, noise = f"imu.{channel}", float(getattr(rig.noise, channel[:-2]))
    way = sign(rng)
    floor = 2.0 * noise
    if place.endswith((".force", ".current")):
        share = 1.0 if place.endswith(".force") else 1.0 / (a.force_per_ampere or 1.0)
        floor = max(2.0 * noise, 2e-3 * a.force_max * share)
    if effect == "sensor_bias":
        return Recipe(effect, place, lambda s: {"offset": way * s}, 3.0 * noise, 1e3 * noise, floor)
    if effect == "sensor_scale":
        return Recipe(effect, place, lambda s: {"scale": math.exp(way * s)}, 0.03, 0.5, 0.004)
    if effect == "sensor_latency":
        return Recipe(effect, place, lambda s: {"delay": s}, 0.003, 0.05, 0.0015)
    return Recipe(effect, place, lambda s: {"step": s}, 6.0 * noise, 1e3 * noise)


def _geometry(rig: RigFile, a: Actuator, rng: np.random.Generator) -> Recipe:
    end = str(rng.choice(["base", "platform"]))
    way = rng.standard_normal(3)
    if isinstance(rig.geometry, MotorcycleGeometry):
        way[1] = way[1] if a.name == "slide" else 0.0
    way /= np.linalg.norm(way)
    return Recipe(
        "geometry_error", f"{a.name}.{end}",
        lambda s: {c: float(s * x) for c, x in zip("xyz", way, strict=True)}, 0.002, 0.04, 0.001,
    )  # fmt: skip


def _platform(rig: RigFile, effect: str, rng: np.random.Generator) -> Recipe:
    m = rig.mass.m
    if effect == "payload_mass":
        return Recipe(effect, "platform", lambda s: {"mass": s}, 0.1 * m, 0.8 * m, 0.05 * m)
    if effect == "static_force_feedback":
        way = -1.0 if rng.random() < 0.7 else 1.0
        return Recipe(effect, "platform", lambda s: {"scale": 1.0 + way * s}, 0.02, 0.5, 0.003)
    axis = isinstance(rig.geometry, AxisGeometry)
    if effect == "base_tilt":
        x = rng.standard_normal(2)
        if axis:
            x[0] = 0.0
        x /= np.linalg.norm(x)
        return Recipe(
            effect,
            "platform",
            lambda s: {"roll": float(s * x[0]), "pitch": float(s * x[1])},
            0.01,
            0.2,
            0.006,
        )
    keys = ("x", "y", "z") if effect == "payload_cog" else ("xx", "yy", "zz")
    y = rng.standard_normal(3)
    if axis:  # a pendulum turns about y
        y = np.array([y[0], 0.0, y[2]]) if effect == "payload_cog" else np.array([0.0, 1.0, 0.0])
    if effect == "payload_inertia":
        y = np.abs(y) + 0.1
    y /= np.linalg.norm(y)
    size = 0.02 if effect == "payload_cog" else 0.1 * rig.mass.inertia[1][1]
    return Recipe(
        effect, "platform", lambda s: {k: float(s * x) for k, x in zip(keys, y, strict=True)},
        size, (0.3 if effect == "payload_cog" else 30.0 * size),
        (0.016 if effect == "payload_cog" else 0.05 * rig.mass.inertia[1][1]),
    )  # fmt: skip
