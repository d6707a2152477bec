"""Effects of the gap catalogue: how one is drawn whose size is still open, and where each makes sense."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from benchmarks.other_lab.effects import Candidate
from benchmarks.other_lab.mechanism import AXIS, MOTORCYCLE, STEWART
from benchmarks.other_lab.motions import FAST, KINDS
from benchmarks.other_lab.world import lead_of


@dataclass(frozen=True)
class Recipe:
    """How to draw an effect: `draw(rng, world, base)` → Candidate; where it makes sense, and on what motions.

    `calibrated`: what an ordinary calibration would absorb, so that a healthy record is needed.
    """

    draw: Callable
    rigs: tuple[int, ...] = (AXIS, MOTORCYCLE, STEWART)
    motions: tuple[str, ...] = KINDS
    imu: bool = False
    calibrated: bool = False


@dataclass(frozen=True)
class Base:
    """What the healthy rig does on the case's runs, by actuator: largest speed, largest and median force, and
    the mean force over a second or so that is passed in a third of the time."""

    speed: np.ndarray
    peak: np.ndarray
    median: np.ndarray
    heat: np.ndarray


def _pick(rng, world):
    i = int(rng.integers(len(world.rig.actuators)))
    return i, world.rig.actuators[i]


def _sign(rng):
    return float(rng.choice((-1.0, 1.0)))


def _on_actuator(effect, parameters, start, low, high):
    """Recipe's draw for one number of one actuator; bounds are functions of the actuator."""

    def draw(rng, world, base):
        _, a = _pick(rng, world)
        return Candidate(effect, a.name, parameters(rng, a), start(a), low(a), high(a))

    return draw


def _one(name):
    return lambda rng, a: lambda size: {name: size}


def _forces(share):
    return lambda a: share * a.force_max


def _about_one(name):
    def parameters(rng, a):
        sign = _sign(rng)
        return lambda size: {name: 1.0 + sign * size}

    return parameters


def _stribeck_parameters(rng, a):
    v = float(rng.uniform(0.004, 0.03))
    return lambda size: {"coulomb": 0.0, "static": size, "velocity": v}


def _asymmetric_parameters(rng, a):
    share = float(rng.uniform(0.0, 0.35))
    names = ("positive", "negative") if rng.random() < 0.5 else ("negative", "positive")
    return lambda size: {names[0]: size, names[1]: share * size}


def _hysteresis_parameters(rng, a):
    way = float(10.0 ** rng.uniform(-3.5, -2.3))
    return lambda size: {"force": size, "displacement": way}


def _compliance_parameters(rng, a):
    ratio = float(rng.uniform(0.04, 0.12))
    load = max(a.effective_mass - a.reflected_mass, 1.0)
    mass = 1.0 / (1.0 / a.reflected_mass + 1.0 / load)
    return lambda size: {"stiffness": 1.0 / size, "damping": 2.0 * ratio * math.sqrt(mass / size)}


def _ripple_parameters(rng, a):
    period = lead_of(a) / float(rng.choice((1.0, 2.0))) if a.transmission else 0.005
    phase = float(rng.uniform(-math.pi, math.pi))
    return lambda size: {"amplitude": size, "period": period, "phase": phase}


def _gain_parameters(rng, a):
    way = rng.dirichlet((0.8, 0.8, 0.5)) * rng.choice((-1.0, 1.0), 3)
    way = way / np.abs(way).max()
    return lambda size: {
        k: float(math.exp(size * w))
        for k, w in zip(("position", "speed", "integral"), way, strict=True)
    }


def _draw_force_limit(rng, world, base):
    i, a = _pick(rng, world)
    peak, room = float(base.peak[i]), float(base.peak[i] - base.median[i])
    return Candidate(
        "force_saturation", a.name, lambda s: {"limit": peak - s * room}, 0.3, 0.05, 0.75
    )


def _draw_speed_limit(rng, world, base):
    i, a = _pick(rng, world)
    peak = float(base.speed[i])
    return Candidate(
        "velocity_saturation", a.name, lambda s: {"limit": peak * (1.0 - s)}, 0.1, 0.005, 0.7
    )


def _draw_lead(rng, world, base):
    _, a = _pick(rng, world)
    if rng.random() < 0.5:
        sign = _sign(rng)
        return Candidate(
            "lead_error", a.name, lambda s: {"scale": 1.0 + sign * s}, 0.005, 2e-4, 0.03
        )
    period = lead_of(a)
    phase = float(rng.uniform(-math.pi, math.pi))
    return Candidate(
        "lead_error",
        a.name,
        lambda s: {"amplitude": s, "period": period, "phase": phase},
        1e-5,
        2e-7,
        1.5e-4,
    )


def _draw_payload_mass(rng, world, base):
    return Candidate(
        "payload_mass", "platform", lambda s: {"mass": s * world.rig.mass.m}, 0.1, 0.003, 0.5
    )


def _direction(rng, names):
    way = rng.standard_normal(len(names))
    way = way / np.linalg.norm(way)
    return lambda size: {k: float(size * w) for k, w in zip(names, way, strict=True)}


def _draw_cog(rng, world, base):
    return Candidate("payload_cog", "platform", _direction(rng, "xyz"), 0.02, 5e-4, 0.12)


def _draw_inertia(rng, world, base):
    way = np.abs(rng.standard_normal(3)) + 0.2
    way = way / way.max()
    of = np.diag(np.array(world.rig.mass.inertia))
    high = 0.9 * float(of.min())

    def parameters(size):
        return {k: float(size * w) for k, w in zip(("xx", "yy", "zz"), way, strict=True)}

    return Candidate("payload_inertia", "platform", parameters, 5.0, 0.2, high)


def _draw_geometry(rng, world, base):
    i, a = _pick(rng, world)
    end = "platform" if rng.random() < 0.5 else "base"
    direction = _direction(rng, "xyz")
    idle = (
        world.kind == MOTORCYCLE and i < 2 and end == "base"
    )  # the y of these joints moves nothing

    def parameters(size):
        p = direction(size)
        return p | {"y": 0.0} if idle else p

    return Candidate("geometry_error", f"{a.name}.{end}", parameters, 2e-3, 1e-4, 0.02)


def _draw_tilt(rng, world, base):
    if world.kind == AXIS:
        sign = _sign(rng)
        return Candidate(
            "base_tilt",
            "platform",
            lambda s: {"roll": 0.2 * s, "pitch": sign * s},
            0.01,
            5e-4,
            0.08,
        )
    return Candidate("base_tilt", "platform", _direction(rng, ("roll", "pitch")), 0.01, 5e-4, 0.05)


def _some_signal(rng, world, imu=True):
    _, a = _pick(rng, world)
    names = [f"{a.name}.position", f"{a.name}.force"]
    if imu:
        channels = (
            ["accel_x"]
            if world.kind == AXIS
            else ["gyro_x", "gyro_y", "gyro_z", "accel_x", "accel_y", "accel_z"]
        )
        names.append(f"imu.{rng.choice(channels)}")
    return str(rng.choice(names))


_UNIT = {"position": 1e-4, "force": 20.0, "gyro": 0.01, "accel": 0.1}
_MOST = {"position": 2e-3, "force": 250.0, "gyro": 0.08, "accel": 1.0}


def _quantity(signal):
    return signal.split(".")[-1].split("_")[0]


def _draw_bias(rng, world, base):
    where, sign = _some_signal(rng, world), _sign(rng)
    unit, most = _UNIT[_quantity(where)], _MOST[_quantity(where)]
    return Candidate("sensor_bias", where, lambda s: {"offset": sign * s}, unit, 0.02 * unit, most)


def _draw_scale(rng, world, base):
    where, sign = _some_signal(rng, world), _sign(rng)
    return Candidate("sensor_scale", where, lambda s: {"scale": 1.0 + sign * s}, 0.03, 5e-4, 0.3)


def _draw_latency(rng, world, base):
    where = _some_signal(rng, world)
    where = "imu" if where.startswith("imu") else where
    return Candidate("sensor_latency", where, lambda s: {"delay": s}, 5e-3, 2e-4, 0.06)


def _draw_quantum(rng, world, base):
    where = _some_signal(rng, world)
    unit, most = _UNIT[_quantity(where)], _MOST[_quantity(where)]
    return Candidate(
        "sensor_quantisation", where, lambda s: {"step": s}, 3.0 * unit, 0.1 * unit, 2.0 * most
    )


def _draw_misalignment(rng, world, base):
    return Candidate("sensor_misalignment", "imu", _direction(rng, "xyz"), 0.02, 1e-3, 0.2)


def _draw_clock(rng, world, base):
    where, sign = str(rng.choice(("imu", "drives"))), _sign(rng)
    return Candidate("clock_drift", where, lambda s: {"rate": sign * s}, 5e-4, 1e-5, 6e-3)


def _draw_lost(rng, world, base):
    also = float(rng.choice((0.0, 1.0)))
    return Candidate(
        "lost_frames", "bus", lambda s: {"setpoints": s, "answers": also * s}, 0.02, 5e-3, 0.25
    )


_PARALLEL = (MOTORCYCLE, STEWART)

RECIPES: dict[str, Recipe] = {
    "coulomb_friction": Recipe(
        _on_actuator("coulomb_friction", _one("force"), _forces(0.01), _forces(1e-3), _forces(0.1)),
        calibrated=True,
    ),
    "viscous_friction": Recipe(
        _on_actuator(
            "viscous_friction",
            _one("coefficient"),
            lambda a: a.viscous,
            lambda a: 0.05 * a.viscous,
            lambda a: 15.0 * a.viscous,
        ),
        motions=FAST,
        calibrated=True,
    ),
    "stribeck_friction": Recipe(
        _on_actuator(
            "stribeck_friction", _stribeck_parameters, _forces(0.02), _forces(1e-3), _forces(0.1)
        ),
        motions=("triangle", "slow_sine", "moves"),
    ),
    "asymmetric_friction": Recipe(
        _on_actuator(
            "asymmetric_friction",
            _asymmetric_parameters,
            _forces(0.02),
            _forces(1e-3),
            _forces(0.1),
        )
    ),
    "load_friction": Recipe(
        _on_actuator(
            "load_friction", _one("coefficient"), lambda a: 0.05, lambda a: 2e-3, lambda a: 0.35
        ),
        motions=FAST,
    ),
    "backlash": Recipe(
        _on_actuator("backlash", _one("gap"), lambda a: 2e-4, lambda a: 5e-6, lambda a: 3e-3),
        motions=FAST,
    ),
    "hysteresis": Recipe(
        _on_actuator(
            "hysteresis", _hysteresis_parameters, _forces(0.02), _forces(1e-3), _forces(0.1)
        )
    ),
    "compliance": Recipe(
        _on_actuator(
            "compliance", _compliance_parameters, lambda a: 3e-7, lambda a: 3e-8, lambda a: 2.5e-6
        ),
        motions=FAST,
    ),
    "actuator_inertia": Recipe(
        _on_actuator(
            "actuator_inertia",
            _one("mass"),
            lambda a: 0.1 * a.effective_mass,
            lambda a: 0.005 * a.effective_mass,
            lambda a: 0.5 * a.effective_mass,
        ),
        motions=FAST,
        calibrated=True,
    ),
    "force_saturation": Recipe(_draw_force_limit, motions=FAST),
    "velocity_saturation": Recipe(_draw_speed_limit, motions=FAST),
    "force_ripple": Recipe(
        _on_actuator(
            "force_ripple", _ripple_parameters, _forces(0.02), _forces(1e-3), _forces(0.08)
        ),
        motions=("triangle", "slow_sine", "moves"),
    ),
    "force_constant": Recipe(
        _on_actuator(
            "force_constant", _about_one("scale"), lambda a: 0.1, lambda a: 0.005, lambda a: 0.4
        ),
        motions=FAST,
        calibrated=True,
    ),
    "loop_gain": Recipe(
        _on_actuator("loop_gain", _gain_parameters, lambda a: 0.2, lambda a: 0.01, lambda a: 0.6),
        motions=FAST,
    ),
    "transport_delay": Recipe(
        _on_actuator(
            "transport_delay", _one("delay"), lambda a: 3e-3, lambda a: 3e-4, lambda a: 0.03
        ),
        motions=FAST,
        calibrated=True,
    ),
    "position_offset": Recipe(
        _on_actuator(
            "position_offset", _one("offset"), lambda a: 2e-3, lambda a: 1e-4, lambda a: 0.012
        ),
        _PARALLEL,
        imu=True,
        calibrated=True,
    ),
    "lead_error": Recipe(_draw_lead, motions=("moves", "ride", "slow_sine", "multisine"), imu=True),
    "payload_mass": Recipe(_draw_payload_mass, motions=FAST, calibrated=True),
    "payload_cog": Recipe(_draw_cog, _PARALLEL),
    "payload_inertia": Recipe(_draw_inertia, _PARALLEL, FAST),
    "geometry_error": Recipe(_draw_geometry, _PARALLEL, imu=True),
    "base_tilt": Recipe(_draw_tilt, imu=True, calibrated=True),
    "sensor_bias": Recipe(_draw_bias, imu=True, calibrated=True),
    "sensor_scale": Recipe(_draw_scale, motions=FAST, imu=True, calibrated=True),
    "sensor_latency": Recipe(_draw_latency, motions=FAST, imu=True, calibrated=True),
    "sensor_quantisation": Recipe(_draw_quantum, imu=True),
    "sensor_misalignment": Recipe(_draw_misalignment, motions=FAST, imu=True, calibrated=True),
    "clock_drift": Recipe(_draw_clock, motions=FAST, imu=True),
    "lost_frames": Recipe(_draw_lost, motions=FAST),
}


def names_for(kind):
    """Effects that make sense on a kind of rig."""
    return [name for name, recipe in RECIPES.items() if kind in recipe.rigs]


__all__ = ["RECIPES", "Base", "Candidate", "Recipe", "names_for"]
