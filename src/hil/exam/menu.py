"""What a case may have: catalogue effects of a rig, each with one size that is then solved for.

A `Recipe` turns a size (0: nothing) into parameters; all its other numbers are drawn once.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np

from hil.config import Actuator, AxisGeometry, MotorcycleGeometry, RigFile

Make = Callable[[float], dict[str, float]]
Sizes = tuple[Make, float, float] | tuple[Make, float, float, float]


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
    return tuple(names)


def draw_recipe(rig: RigFile, effect: str, signals: set[str], rng: np.random.Generator) -> Recipe:
    """Place and numbers of a catalogue `effect`; `signals`: recorded quantities, "imu" among them."""
    a = rig.actuators[rng.integers(len(rig.actuators))]
    make = _ACTUATOR.get(effect)
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


def sign(rng: np.random.Generator) -> float:
    """1 or -1."""
    return 1.0 if rng.random() < 0.5 else -1.0


def _coulomb(a: Actuator, rng: np.random.Generator) -> Sizes:
    return lambda s: {"force": s}, 0.01 * a.force_max, 0.2 * a.force_max, 0.25 * a.coulomb


def _viscous(a: Actuator, rng: np.random.Generator) -> Sizes:
    most = 0.5 * a.force_max / a.velocity_max
    return (
        lambda s: {"coefficient": s},
        2.0 * a.viscous,
        most,
        max(0.4 * a.viscous, 4e-3 * a.force_max),
    )


def _stribeck(a: Actuator, rng: np.random.Generator) -> Sizes:
    ratio = rng.uniform(1.8, 3.5)
    v = float(np.exp(rng.uniform(math.log(0.004), math.log(0.03)))) * a.velocity_max / 0.375
    return (
        lambda s: {"coulomb": s, "static": ratio * s, "velocity": v},
        0.008 * a.force_max,
        0.1 * a.force_max,
    )


def _asymmetric(a: Actuator, rng: np.random.Generator) -> Sizes:
    ratio = rng.uniform(0.1, 0.5)
    if rng.random() < 0.5:
        return (
            lambda s: {"positive": s, "negative": ratio * s},
            0.015 * a.force_max,
            0.2 * a.force_max,
        )
    return lambda s: {"positive": ratio * s, "negative": s}, 0.015 * a.force_max, 0.2 * a.force_max


def _load(a: Actuator, rng: np.random.Generator) -> Sizes:
    way = rng.uniform(-0.3, 0.6)
    return lambda s: {"coefficient": s, "asymmetry": way}, 0.05, 0.5


def _backlash(a: Actuator, rng: np.random.Generator) -> Sizes:
    span = a.stroke[1] - a.stroke[0]
    return lambda s: {"gap": s}, 1e-3 * span, 0.01 * span


def _hysteresis(a: Actuator, rng: np.random.Generator) -> Sizes:
    way = float(np.exp(rng.uniform(math.log(0.001), math.log(0.012)))) * (a.stroke[1] - a.stroke[0])
    return lambda s: {"force": s, "displacement": way}, 0.015 * a.force_max, 0.2 * a.force_max


def _compliance(a: Actuator, rng: np.random.Generator) -> Sizes:
    load = max(a.effective_mass - a.reflected_mass, 0.4 * a.effective_mass)
    stiff = load * (2.0 * math.pi * 25.0) ** 2
    share = rng.uniform(0.03, 0.1)

    def make(s: float) -> dict[str, float]:
        k = stiff / s
        return {"stiffness": k, "damping": 2.0 * share * math.sqrt(k * load)}

    return make, 1.0, 20.0


def _inertia(a: Actuator, rng: np.random.Generator) -> Sizes:
    return lambda s: {"mass": s}, 0.1 * a.effective_mass, a.effective_mass, 0.05 * a.effective_mass


def _ripple(a: Actuator, rng: np.random.Generator) -> Sizes:
    span = a.stroke[1] - a.stroke[0]
    lead = getattr(a.transmission, "lead", None) or 0.02 * span
    period = float(rng.choice([1.0, 1.0, 0.5])) * lead
    phase = rng.uniform(0.0, 6.28)
    return (
        lambda s: {"amplitude": s, "period": period, "phase": phase},
        0.01 * a.force_max,
        0.15 * a.force_max,
    )


def _constant(a: Actuator, rng: np.random.Generator) -> Sizes:
    way = sign(rng)
    return lambda s: {"scale": math.exp(way * s)}, 0.05, 0.5, 0.02


def _gains(a: Actuator, rng: np.random.Generator) -> Sizes:
    keys = ["position", "speed"] + (["integral"] if a.law == "cascade" else [])
    key = keys[rng.integers(len(keys))]
    way = -1.0 if rng.random() < 0.7 else 1.0
    return (
        lambda s: {
            k: math.exp(way * s) if k == key else 1.0 for k in ("position", "speed", "integral")
        },
        0.15,
        0.9 if way < 0.0 else 0.45,
        0.03,
    )


def _delay(a: Actuator, rng: np.random.Generator) -> Sizes:
    return lambda s: {"delay": s}, 0.002, 0.04, 0.0015


def _offset(a: Actuator, rng: np.random.Generator) -> Sizes:
    way = sign(rng)
    span = a.stroke[1] - a.stroke[0]
    return lambda s: {"offset": way * s}, 0.003 * span, 0.04 * span


def _lead(a: Actuator, rng: np.random.Generator) -> Sizes:
    if rng.random() < 0.5:
        way = sign(rng)
        return lambda s: {"scale": 1.0 + way * s}, 0.02, 0.15, 0.005
    lead = getattr(a.transmission, "lead", None) or 0.02 * (a.stroke[1] - a.stroke[0])
    return (
        lambda s: {"scale": 1.0, "amplitude": s, "period": lead},
        0.004 * lead,
        0.08 * lead,
    )


def _force_limit(a: Actuator, rng: np.random.Generator) -> Sizes:
    return lambda s: {"limit": a.force_max * math.exp(-s)}, 1.0, 4.5


def _speed_limit(a: Actuator, rng: np.random.Generator) -> Sizes:
    return lambda s: {"limit": a.velocity_max * math.exp(-s)}, 1.0, 4.0


_ACTUATOR: Final = {
    "coulomb_friction": _coulomb,
    "viscous_friction": _viscous,
    "stribeck_friction": _stribeck,
    "asymmetric_friction": _asymmetric,
    "load_friction": _load,
    "backlash": _backlash,
    "hysteresis": _hysteresis,
    "compliance": _compliance,
    "actuator_inertia": _inertia,
    "force_saturation": _force_limit,
    "velocity_saturation": _speed_limit,
    "force_ripple": _ripple,
    "force_constant": _constant,
    "loop_gain": _gains,
    "transport_delay": _delay,
    "position_offset": _offset,
    "lead_error": _lead,
}


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
