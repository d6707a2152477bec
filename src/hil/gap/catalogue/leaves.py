"""The candidates: every effect of the catalogue at every place where these data could show it.

A leaf is one effect at one place. Its parameters enter the twin's answer partly in proportion (a force, a
mass) and partly not (a period, a width), so each leaf has one or more starts: values of the latter, with the
columns by which the former are moved. Starts span what rigs of this class show; fits go on from there.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hil.config import Actuator, AxisGeometry
from hil.gap.catalogue.periods import force_periods, lead_periods, with_turn
from hil.gap.record.leaf import Changes, Leaf, Start
from hil.gap.record.problem import Problem

Array = NDArray[np.float64]

SATURATED: Final = (1.0, 0.92, 1.06, 1.13)
"""Times the largest force or speed that the record itself has, where limits are looked for."""
FASTEST: Final = 3
"""Largest but two: a single wrong answer, which is in two differences, is no speed."""
REACHED: Final = 0.995
"""Of what the twin needs: a rig that reached as much was not limited."""
GAPS_M: Final = (
    1.5e-5,
    3e-5,
    5.5e-5,
    1e-4,
    1.7e-4,
    2.8e-4,
    4.5e-4,
    7e-4,
    1.1e-3,
    1.6e-3,
    2.4e-3,
    3.5e-3,
    5e-3,
    7.5e-3,
    1.1e-2,
    1.6e-2,
)
"""When a flank is met, and how hard, changes with the gap: no linear picture of one holds far from it."""
WIDEST: Final = 0.5
"""Of how far an actuator moves, m or rad: in a wider gap it seldom meets both flanks."""
DELAYS_S: Final = (0.001, 0.002, 0.003, 0.0045, 0.006, 0.008, 0.01, 0.0125, 0.015, 0.02)
"""Forces have the cycle of the setpoints in them, so a delay has a best value in each cycle."""
IMU_DELAYS_S: Final = (*DELAYS_S, 0.03, 0.05, 0.08, 0.12)
"""Of the IMU as a whole: it comes by a way of its own, through filters and other computers."""
RATES: Final = (2e-5, 6e-5, 1.3e-4, 3e-4, 1e-3, 3e-3, 6e-3)
"""Of a clock, s/s: over a record even small ones move signals by more than any linear picture holds."""
SWINGS_HZ: Final = (5.0, 8.0, 12.0, 18.0, 27.0, 40.0)
"""Of the load on a transmission that gives, its motor held: what a drive carries swings nowhere else."""
DAMPED: Final = 0.08
"""Of critical."""
WIDTHS_M: Final = (2e-4, 6e-4, 2e-3, 1e-2)
STRIBECK: Final = (0.008, 0.04, 0.16)
"""Of an actuator's largest speed, down to which its static friction goes."""


def find_leaves(
    problem: Problem, vector: Array, residual: Array, without: Collection[str] = ()
) -> list[Leaf]:
    """All leaves for a problem whose twin at `vector` leaves `residual` (N,), without some effects.

    Effects of sensors that no signal shows, of an IMU that is not there and of frames (see
    `hil.gap.fits.frames`) are not among them.
    """
    own = problem.own_leaves(without)
    if own is not None:
        return _placed(own)
    rig = problem.rig
    motion = problem.motion(vector)
    out: list[Leaf] = []
    for a in rig.actuators:
        out += _actuator(problem, a, motion, residual)
        for quantity in ("position", "velocity", "force", "current"):
            if f"{a.name}.{quantity}" in problem.signals:
                out += _sensor(f"{a.name}.{quantity}", problem, a.name)
    out += _platform(problem)
    return _placed([leaf for leaf in out if leaf.effect not in without])


def _placed(leaves: Sequence[Leaf]) -> list[Leaf]:
    count = Counter(leaf.effect for leaf in leaves)
    return [replace(leaf, places=count[leaf.effect]) for leaf in leaves]


def _actuator(
    problem: Problem, a: Actuator, motion: Iterable[Mapping[str, Array]], residual: Array
) -> list[Leaf]:
    name, table = a.name, problem.table

    def leaf(effect: str, parameters: str, starts: Iterable[tuple[Changes, ...]]) -> Leaf:
        """Starts given as (fixed, column, ...) by short names."""
        full = f"{name}.{effect}."
        made = tuple(Start(_full(full, s[0]), tuple(_full(full, c) for c in s[1:])) for s in starts)
        return Leaf(effect, name, tuple(full + p for p in parameters.split()), made, name)

    def scale(effect: str, parameter: str) -> float:
        return table[f"{name}.{effect}.{parameter}"].scale

    f = scale("coulomb_friction", "force")
    force_n = max(float(np.max(np.abs(m[f"{name}.force"]))) for m in motion)
    speed = max(float(np.max(np.abs(m[f"{name}.velocity"]))) for m in motion)
    travel = max(float(np.ptp(m[f"{name}.position"])) for m in motion)
    out = [
        leaf("coulomb_friction", "force", [({}, {"force": f})]),
        leaf("viscous_friction", "coefficient",
             [({}, {"coefficient": scale("viscous_friction", "coefficient")})]),
        leaf("stribeck_friction", "coulomb static velocity",
             [({"velocity": v * a.velocity_max}, {"coulomb": f, "static": f}, {"static": f})
              for v in STRIBECK]),
        leaf("asymmetric_friction", "positive negative", [({}, {"positive": f}, {"negative": f})]),
        leaf("load_friction", "coefficient asymmetry",
             [({"asymmetry": s}, {"coefficient": 0.03}) for s in (0.0, 0.8, -0.8)]),
        leaf("backlash", "gap",
             [({}, {"gap": g}) for g in GAPS_M if g < max(WIDEST * travel, 2.0 * GAPS_M[0])]),
        leaf("hysteresis", "force displacement",
             [({"displacement": x}, {"force": f}) for x in WIDTHS_M]),
        leaf("compliance", "stiffness damping hardening", [_spring(a, f_hz) for f_hz in SWINGS_HZ]),
        leaf("actuator_inertia", "mass", [({}, {"mass": scale("actuator_inertia", "mass")})]),
        leaf("force_constant", "scale", [({}, {"scale": 1.05})]),
        leaf("loop_gain", "position speed integral",
             [({}, {"position": 1.1}, {"speed": 1.1}, {"integral": 1.15})]),
    ]  # fmt: skip
    for limit, most in (("force_saturation", force_n), ("velocity_saturation", speed)):
        top = table[f"{name}.{limit}.limit"].upper
        reached = _reached(problem, name, limit)
        if not reached or max(reached) > REACHED * most:
            continue
        starts: list[tuple[Changes, ...]] = [
            ({"knee": 0.0}, {"limit": s * r})
            for r in reached
            for s in SATURATED
            if 0.0 < s * r < top
        ]
        if starts:
            out.append(leaf(limit, "limit knee", starts))
    periods = with_turn(force_periods(problem, residual, name), a, travel)
    if periods:
        out.append(
            leaf("force_ripple", "amplitude period phase",
                     [({"period": p}, *_waves(f)) for p in periods])
        )  # fmt: skip
    out.append(leaf("transport_delay", "delay", [({}, {"delay": d}) for d in DELAYS_S]))
    out.append(
        leaf("position_offset", "offset", [({}, {"offset": scale("position_offset", "offset")})])
    )
    lead: list[tuple[Changes, ...]] = [({}, {"scale": 1.005})]
    lead += [
        ({"period": p}, *_waves(scale("lead_error", "amplitude")))
        for p in with_turn(lead_periods(problem, residual, name), a, travel)
    ]
    out.append(leaf("lead_error", "scale amplitude period phase", lead))
    return out


def _spring(a: Actuator, swing_hz: float) -> tuple[Changes, Changes]:
    """What is set, and the stiffness on which what the actuator carries swings with `swing_hz`."""
    stiffness, damping = spring(a, swing_hz)
    return {"damping": damping, "hardening": 0.0}, {"stiffness": stiffness}


def spring(a: Actuator, swing_hz: float) -> tuple[float, float]:
    """Stiffness (N/m) on which what an actuator carries swings with `swing_hz`, and damping (N·s/m)."""
    load_kg = max(a.effective_mass - a.reflected_mass, 0.1 * a.effective_mass)
    stiffness = load_kg * (2.0 * math.pi * swing_hz) ** 2
    return stiffness, 2.0 * DAMPED * math.sqrt(stiffness * load_kg)


def _waves(amplitude: float) -> tuple[Changes, Changes]:
    """The columns of a wave of any phase: two that are a quarter turn apart."""
    return (
        {"amplitude": amplitude, "phase": 0.0},
        {"amplitude": amplitude, "phase": 0.5 * math.pi},
    )


def _reached(problem: Problem, actuator: str, limit: str) -> tuple[float, ...]:
    """Largest force or speed in the record, short of few samples; of speed, which no frame's kick makes, the
    largest of all as well. None of either where it has no such signal."""
    quantity = "force" if limit == "force_saturation" else "position"
    a = next(a for a in problem.rig.actuators if a.name == actuator)
    out: list[float] = []
    tops: list[float] = []
    for x in problem.series:
        if x.actuator != actuator:
            continue
        t, v = problem.t_s[x.part], problem.measured[x.part]
        if quantity == "force" and x.quantity in ("force", "current"):
            unit = 1.0 if x.quantity == "force" else (a.force_per_ampere or 1.0)
            out.append(float(np.quantile(np.abs(v * unit), 0.995)))
        elif x.quantity == quantity and len(t) > 10:
            speed = np.abs((v[4:] - v[:-4]) / (t[4:] - t[:-4]))
            out.append(float(np.quantile(speed, 0.995)))
            tops.append(float(np.sort(speed)[-FASTEST]))
    return tuple(max(values) for values in (out, tops) if values)


def _sensor(signal: str, problem: Problem, actuator: str | None) -> list[Leaf]:
    table = problem.table
    values = {
        "sensor_bias": ("offset", (table[f"{signal}.sensor_bias.offset"].scale,)),
        "sensor_scale": ("scale", (1.02,)),
        "sensor_latency": ("delay", DELAYS_S),
    }
    out = []
    for effect, (parameter, points) in values.items():
        name = f"{signal}.{effect}.{parameter}"
        starts = tuple(Start({}, ({name: v},)) for v in points)
        out.append(Leaf(effect, signal, (name,), starts, actuator))
    return out


def _platform(problem: Problem) -> list[Leaf]:
    rig, table = problem.rig, problem.table
    out = []

    def linear(
        effect: str, location: str, parameters: Iterable[str], *, joint: bool = True
    ) -> None:
        names = tuple(f"{location}.{effect}.{p}" for p in parameters)
        steps = []
        for n in names:
            p = table[n]
            steps.append({n: p.neutral + p.scale})
        starts = (Start({}, tuple(steps)),) if joint else tuple(Start({}, (s,)) for s in steps)
        out.append(Leaf(effect, location, names, starts, None))

    linear("payload_mass", "platform", ("mass",))
    geometry = rig.geometry
    multi = not isinstance(geometry, AxisGeometry)
    if not isinstance(geometry, AxisGeometry) or geometry.load == "pendulum":
        linear("payload_cog", "platform", "xyz")
        linear("payload_inertia", "platform", ("xx", "yy", "zz"))
    if any(a.static_ff for a in rig.actuators):
        linear("static_force_feedback", "platform", ("scale",))
    linear("base_tilt", "platform", ("roll", "pitch"))
    if multi:
        for a in rig.actuators:
            for end in ("base", "platform"):
                linear("geometry_error", f"{a.name}.{end}", "xyz")
    channels = [s for s in problem.signals if s.startswith("imu.")]
    for channel in channels:
        out += _sensor(channel, problem, None)
    if channels:
        late = "imu.sensor_latency.delay"
        starts = tuple(Start({}, ({late: d},)) for d in IMU_DELAYS_S)
        out.append(Leaf("sensor_latency", "imu", (late,), starts, None))
        linear("sensor_scale", "imu", ("scale",))
        linear("sensor_misalignment", "imu", "xyz")
        out.append(_clock("imu"))
    if any(not s.startswith("imu.") for s in problem.signals):
        out.append(_clock("drives"))
    return out


def _clock(group: str) -> Leaf:
    name = f"{group}.clock_drift.rate"
    starts = tuple(Start({}, ({name: sign * r},)) for r in RATES for sign in (1.0, -1.0))
    return Leaf("clock_drift", group, (name,), starts, None)


def _full(prefix: str, values: Changes) -> dict[str, float]:
    return {prefix + k: v for k, v in values.items()}
