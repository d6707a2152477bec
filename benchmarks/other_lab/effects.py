"""Effects of the gap catalogue: how each changes a rig."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from benchmarks.other_lab import layout as lay


@dataclass
class Candidate:
    """An effect with one open number: `parameters(size)`, from `low` to `high`, `start` a first guess."""

    effect: str
    location: str
    parameters: Callable[[float], dict[str, float]]
    start: float
    low: float
    high: float

    def apply(self, world, setup, size):
        """A copy of the rig with the effect of this size."""
        out = setup.copy()
        _APPLY[self.effect](world, out, self.location, self.parameters(size))
        return out


def _rows(*pairs):
    """Effects that add to, or replace, rows of one actuator: (parameter, row, "add" | "set" | "times")."""

    def apply(world, setup, location, p):
        i = world.rig.actuator_names.index(location)
        for parameter, row, how in pairs:
            if parameter not in p:
                continue
            if how == "add":
                setup.act[row, i] += p[parameter]
            elif how == "times":
                setup.act[row, i] *= p[parameter]
            else:
                setup.act[row, i] = p[parameter]

    return apply


def _coulomb(world, setup, location, p):
    i = world.rig.actuator_names.index(location)
    before = setup.act[lay.COUL_P, i]
    setup.act[lay.COUL_P, i] += p.get("force", p.get("positive", 0.0))
    setup.act[lay.COUL_N, i] += p.get("force", p.get("negative", 0.0))
    _keep_presliding(setup, i, before)


def _stribeck(world, setup, location, p):
    i = world.rig.actuator_names.index(location)
    before = setup.act[lay.COUL_P, i]
    setup.act[[lay.COUL_P, lay.COUL_N], i] += p["coulomb"]
    setup.act[lay.STAT, i] += p["static"] - p["coulomb"]
    setup.act[lay.VSTR, i] = p["velocity"]
    if p["static"] > p["coulomb"]:
        _keep_presliding(setup, i, before)


def _keep_presliding(setup, i, before):
    """LuGre's bristles get stiffer with the friction, so that it yields after the same way as before."""
    if setup.act[lay.LAW, i] == lay.LUGRE:
        more = (setup.act[lay.COUL_P, i] + setup.act[lay.STAT, i]) / before
        setup.act[lay.SIG0, i] *= more
        setup.act[lay.SIG1, i] *= math.sqrt(more)


def _compliance(world, setup, location, p):
    i = world.rig.actuator_names.index(location)
    setup.act[lay.KT, i] = p["stiffness"]
    setup.act[lay.DT, i] = p["damping"]


def _payload_mass(world, setup, location, p):
    setup.body[0] += p["mass"]


def _vector(attribute, first, names):
    def apply(world, setup, location, p):
        target = getattr(setup, attribute)
        for k, name in enumerate(names):
            target[first + k] += p.get(name, 0.0)

    return apply


def _geometry(world, setup, location, p):
    actuator, end = location.split(".")
    i = world.rig.actuator_names.index(actuator)
    setup.joints[i, int(end == "platform")] += [p["x"], p["y"], p["z"]]


def _tilt(world, setup, location, p):
    roll, pitch, g = p["roll"], p["pitch"], world.rig.mass.gravity
    level = setup.grav - [0.0, 0.0, -g]
    turned = [math.sin(pitch), -math.cos(pitch) * math.sin(roll), -math.cos(pitch) * math.cos(roll)]
    setup.grav = level + g * np.array(turned)


def _delay(world, setup, location, p):
    setup.setpoint_delay[world.rig.actuator_names.index(location)] += p["delay"]


def _sensor(field, parameter, how):
    def apply(world, setup, location, p):
        sensor = setup.sensor(location)
        old = getattr(sensor, field)
        setattr(sensor, field, old * p[parameter] if how == "times" else old + p[parameter])

    return apply


def _clock(world, setup, location, p):
    setattr(setup, f"clock_{location}", p["rate"])


def _lost(world, setup, location, p):
    setup.lost_setpoints, setup.lost_answers = p["setpoints"], p["answers"]


_APPLY = {
    "coulomb_friction": _coulomb,
    "asymmetric_friction": _coulomb,
    "stribeck_friction": _stribeck,
    "viscous_friction": _rows(("coefficient", lay.VIS, "add")),
    "load_friction": _rows(("coefficient", lay.LOADMU, "add")),
    "backlash": _rows(("gap", lay.GAP, "add")),
    "hysteresis": _rows(("force", lay.HYS_F, "set"), ("displacement", lay.HYS_D, "set")),
    "compliance": _compliance,
    "actuator_inertia": _rows(("mass", lay.MR, "add")),
    "force_saturation": _rows(("limit", lay.FMAX, "set")),
    "velocity_saturation": _rows(("limit", lay.VMAX, "set")),
    "force_ripple": _rows(
        ("amplitude", lay.RIP_A, "set"), ("period", lay.RIP_P, "set"), ("phase", lay.RIP_PH, "set")
    ),
    "force_constant": _rows(("scale", lay.KF, "times")),
    "loop_gain": _rows(
        ("position", lay.KP, "times"), ("speed", lay.KV, "times"), ("integral", lay.KI, "times")
    ),
    "transport_delay": _delay,
    "position_offset": _rows(("offset", lay.OFFSET, "add")),
    "lead_error": _rows(
        ("scale", lay.LEAD, "times"),
        ("amplitude", lay.LEAD_A, "set"),
        ("period", lay.LEAD_P, "set"),
        ("phase", lay.LEAD_PH, "set"),
    ),
    "payload_mass": _payload_mass,
    "payload_cog": _vector("body", 1, "xyz"),
    "payload_inertia": _vector("body", 4, ("xx", "yy", "zz")),
    "geometry_error": _geometry,
    "base_tilt": _tilt,
    "sensor_bias": _sensor("bias", "offset", "add"),
    "sensor_scale": _sensor("scale", "scale", "times"),
    "sensor_latency": _sensor("latency_s", "delay", "add"),
    "sensor_quantisation": _sensor("step", "step", "add"),
    "sensor_misalignment": _vector("misalignment", 0, "xyz"),
    "clock_drift": _clock,
    "lost_frames": _lost,
}
