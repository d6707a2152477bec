"""The effects of the gap catalogue: where each may stand, its parameters, units, neutral values, bounds.

Names, locations and parameters are a contract with runs, rig files and reports: add, never rename. At
its neutral values an effect vanishes. Friction parameters are added to the rig file's own friction and
delays to its own delays, so negative values, down to what the rig file has, are allowed there: a fit
needs both sides. `scale` is the size at which an effect matters on a rig of this class [R]: it makes
parameters comparable, it is no limit; 0 for what is chosen and never fitted. An actuator may be a leg of
metres and newtons or a shaft of radians and newton metres, so what has a size of its own is measured by its
travel, speed, force and mass.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, Literal

from hil.config import Actuator

Value = float | Callable[[Actuator], float]
Search = Literal["linear", "reciprocal"]
QUANTITIES = ("position", "velocity", "force", "current")
IMU_CHANNELS = ("gyro_x", "gyro_y", "gyro_z", "accel_x", "accel_y", "accel_z")


@dataclass(frozen=True, slots=True)
class Spec:
    """A parameter of an effect; values that depend on the actuator are functions of it."""

    parameter: str
    unit: str
    neutral: Value
    lower: Value
    upper: Value
    scale: Value
    search: Search = "linear"
    """reciprocal: the neutral value is infinite, so steps and bounds hold for 1 / value."""


Effects = dict[str, tuple[Spec, ...]]


def _own_friction(a: Actuator) -> float:
    return -a.coulomb


def _force(share: float) -> Callable[[Actuator], float]:
    return lambda a: share * a.force_max


def _travel(share: float) -> Callable[[Actuator], float]:
    return lambda a: share * (a.stroke[1] - a.stroke[0])


def _speed(share: float) -> Callable[[Actuator], float]:
    return lambda a: share * a.velocity_max


def _carried(per_mass: float) -> Callable[[Actuator], float]:
    """Of what the drive moves, kg or kg·m²: stiffness in 1/s², damping in 1/s."""
    return lambda a: per_mass * a.effective_mass


def _at_least(least: float, value: Callable[[Actuator], float]) -> Callable[[Actuator], float]:
    return lambda a: max(least, value(a))


def _coulomb(parameter: str) -> Spec:
    return Spec(parameter, "N", 0.0, _own_friction, _force(0.5), _force(0.01))


def _viscous(parameter: str) -> Spec:
    return Spec(
        parameter, "N·s/m", 0.0, lambda a: -a.viscous, 1e5,
        lambda a: 0.5 * a.viscous + 0.0025 * a.force_max / a.velocity_max,
    )  # fmt: skip


KNEE = Spec("knee", "1", 0.0, 0.0, 0.9, 0.2)
"""How softly what is asked for bends over to a limit; 0: it is cut off there."""

ACTUATOR: Effects = {
    "coulomb_friction": (
        _coulomb("force"),
        Spec("presliding", "m", 0.0, 0.0, _travel(1e-3), _travel(5e-5)),
    ),
    "viscous_friction": (_viscous("coefficient"),),
    "stribeck_friction": (
        _coulomb("coulomb"),
        _coulomb("static"),
        Spec("velocity", "m/s", 0.01, 1e-4, _at_least(0.5, _speed(0.5)), 0.01),
    ),
    "asymmetric_friction": (_coulomb("positive"), _coulomb("negative")),
    "asymmetric_viscous_friction": (_viscous("positive"), _viscous("negative")),
    "load_friction": (
        Spec("coefficient", "1", 0.0, 0.0, 0.8, 0.03),
        Spec("asymmetry", "1", 0.0, -1.0, 1.0, 0.3),
    ),
    "backlash": (Spec("gap", "m", 0.0, 0.0, _at_least(0.02, _travel(0.02)), _travel(4e-4)),),
    "hysteresis": (
        Spec("force", "N", 0.0, 0.0, _force(0.5), _force(0.01)),
        Spec("displacement", "m", 1e-3, 1e-6, 0.1, 1e-3),
    ),
    "compliance": (
        Spec("stiffness", "N/m", math.inf, lambda a: min(1e3, 10.0 * a.effective_mass), math.inf,
             _carried(1e4), "reciprocal"),
        Spec("damping", "N·s/m", 0.0, 0.0, 1e6, _carried(2.5)),
        Spec("hardening", "1", 0.0, 0.0, 20.0, 0.3),
    ),
    "actuator_inertia": (
        Spec("mass", "kg", 0.0, lambda a: -0.9 * a.reflected_mass, 1e3, lambda a: 0.05 * a.effective_mass),
    ),
    "force_saturation": (
        Spec("limit", "N", lambda a: a.force_max, 0.0, lambda a: a.force_max, _force(0.3)),
        KNEE,
    ),
    "velocity_saturation": (
        Spec("limit", "m/s", lambda a: a.velocity_max, 0.0, lambda a: a.velocity_max,
             lambda a: 0.3 * a.velocity_max),
        KNEE,
    ),
    "force_ripple": (
        Spec("amplitude", "N", 0.0, 0.0, _force(0.5), _force(0.01)),
        Spec("period", "m", 0.005, 1e-4, 1.0, 0.005),
        Spec("phase", "rad", 0.0, -2.0 * math.pi, 2.0 * math.pi, 1.0),
    ),
    "force_constant": (Spec("scale", "1", 1.0, 0.1, 3.0, 0.05),),
    "loop_gain": (
        Spec("position", "1", 1.0, 0.05, 5.0, 0.2),
        Spec("speed", "1", 1.0, 0.05, 5.0, 0.2),
        Spec("integral", "1", 1.0, 0.0, 10.0, 0.3),
    ),
    "transport_delay": (Spec("delay", "s", 0.0, -0.05, 0.2, 2e-3),),
    "position_offset": (Spec("offset", "m", 0.0, _travel(-0.25), _travel(0.25), _travel(2e-3)),),
    "lead_error": (
        Spec("scale", "1", 1.0, 0.8, 1.2, 5e-3),
        Spec("amplitude", "m", 0.0, 0.0, _at_least(3e-3, _travel(5e-3)), _travel(1e-4)),
        Spec("period", "m", 0.005, 1e-4, 1.0, 0.005),
        Spec("phase", "rad", 0.0, -2.0 * math.pi, 2.0 * math.pi, 1.0),
    ),
}  # fmt: skip

SENSOR_LATENCY = Spec("delay", "s", 0.0, -0.05, 0.2, 2e-3)
QUANTITY_UNIT = {"position": "m", "velocity": "m/s", "force": "N", "current": "A"}
QUANTITY_SCALE: dict[str, Value] = {
    "position": _travel(1e-3), "velocity": _speed(0.0125), "force": _force(0.01),
    "current": lambda a: 0.01 * a.force_max / (a.force_per_ampere or a.force_max / 10.0),
}  # fmt: skip


def sensor_effects(unit: str, scale: Value) -> Effects:
    """The four effects that any one signal may have; `unit` and `scale` of the signal itself."""
    return {
        "sensor_bias": (Spec("offset", unit, 0.0, -math.inf, math.inf, scale),),
        "sensor_scale": (Spec("scale", "1", 1.0, 0.1, 3.0, 0.02),),
        "sensor_latency": (SENSOR_LATENCY,),
        "sensor_quantisation": (Spec("step", unit, 0.0, 0.0, math.inf, scale),),
    }


def _vector(unit: str, names: tuple[str, ...], bound: float, scale: float) -> tuple[Spec, ...]:
    return tuple(Spec(name, unit, 0.0, -bound, bound, scale) for name in names)


PLATFORM: Effects = {
    "payload_mass": (Spec("mass", "kg", 0.0, -1e3, 5e3, 10.0),),
    "payload_cog": _vector("m", ("x", "y", "z"), 1.0, 0.02),
    "payload_inertia": _vector("kg·m²", ("xx", "yy", "zz"), 1e3, 3.0),
    "static_force_feedback": (Spec("scale", "1", 1.0, 0.0, 2.0, 0.02),),
    "base_tilt": _vector("rad", ("roll", "pitch"), 0.3, 0.01),
}
MISALIGNMENT: Effects = {"sensor_misalignment": _vector("rad", ("x", "y", "z"), 0.5, 0.01)}
GEOMETRY: Effects = {"geometry_error": _vector("m", ("x", "y", "z"), 0.1, 2e-3)}
CLOCK: Effects = {"clock_drift": (Spec("rate", "s/s", 0.0, -0.01, 0.01, 2e-4),)}
BUS: Effects = {
    "lost_frames": (
        Spec("setpoints", "1", 0.0, 0.0, 0.9, 0.02),
        Spec("answers", "1", 0.0, 0.0, 0.9, 0.02),
    )
}
BICYCLE: Effects = {
    "front_suspension": (
        Spec("stiffness", "N/m", math.inf, 1e3, math.inf, 2e4, "reciprocal"),
        Spec("damping", "N·s/m", 500.0, 0.0, 1e5, 300.0),
    ),
    "tyre_compliance": (
        Spec("stiffness", "N/m", math.inf, 1e4, math.inf, 3e5, "reciprocal"),
        Spec("damping", "N·s/m", 200.0, 0.0, 1e5, 200.0),
    ),
    "rider_motion": (
        Spec("stiffness", "N·m/rad", math.inf, 200.0, math.inf, 3e3, "reciprocal"),
        Spec("damping", "N·m·s/rad", 100.0, 0.0, 1e4, 100.0),
        Spec("gain", "1", 0.0, -2.0, 2.0, 0.2),
    ),
}  # fmt: skip
LEAN_TORQUE: Effects = {
    "sensor_bias": (Spec("offset", "N·m", 0.0, -math.inf, math.inf, 3.0),),
    "tyre_section": (Spec("radius", "m", 0.0, -0.1, 0.1, 0.01),),
}
"""Of the torque that leans a bicycle, which no sensor tells: a rider who sits to one side has one all the
way, and tyres of a round section roll on their flanks, so that less of the weight's arm is left."""
WHEEL: Effects = {"wheel_radius": (Spec("scale", "1", 1.0, 0.8, 1.2, 0.01),)}
FRAME: Final = Spec("frame", "1", 1.0, 0.0, 1.0, 0.0)
"""Of a rear wheel that is larger than the rig file's: 1 where the frame stands higher on it and is pitched,
0 where the frame and all on it stand as the file says and only the way that a turn rolls is another."""
REAR_WHEEL: Effects = {"wheel_radius": (*WHEEL["wheel_radius"], FRAME)}
SLIP: Effects = {
    "wheel_slip": (Spec("coefficient", "1", 0.0, -0.2, 0.5, 0.01),),
    "drive_slip": (Spec("per_accel", "s²/m", 0.0, 0.0, 0.05, 0.002),),
    "side_slip": (Spec("per_accel", "rad·s²/m", 0.0, -0.05, 0.05, 0.001),),
}
"""Of the wheel that drives: a share of its way, whatever it does; and a share for each m/s² that it drives or
brakes with, as tyres creep under load, and an angle for each m/s² across, as they slip aside (both wheels
alike), which are no findings."""


def size(effects: Effects) -> int:
    """Number of parameters of all `effects`."""
    return sum(len(specs) for specs in effects.values())


def index(effects: Effects, effect: str, parameter: str) -> int:
    """Place of a parameter within the block of `effects`."""
    flat = [(name, spec.parameter) for name, specs in effects.items() for spec in specs]
    return flat.index((effect, parameter))
