"""What a healthy rig is off its rig file by [R]: small enough to be no finding, large enough that no model is
ever right.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hil.config import RigFile
from hil.exam.world import layout as lay
from hil.exam.world.body import World
from hil.rigs.pack import (
    kind_code,
    pack_body,
    pack_fed_legs,
    pack_geometry,
    pack_gravity,
    pack_legs,
)
from hil.runs.folder import run_mode

Array = NDArray[np.float64]

STEP_S = 6.25e-5
SETTLE_S = 1.2
COUNT = 2e-8
"""Increment of the drives' own encoders, m or rad: they interpolate far below what they answer."""


TICK_DRIFT = 2e-5
"""s/s by which a drive's own clock may be off the bus master's, on every second rig."""


@dataclass(frozen=True, slots=True)
class Scatter:
    """A seed and a size of everything by which a healthy rig differs from its rig file (0: nothing does)."""

    seed: int
    size: float = 1.0


def scattered(rig: RigFile, rng: np.random.Generator, size: float) -> World:
    """`rig` with everything off by up to `size` of its spread."""
    n = len(rig.actuators)

    def off(spread: float, *shape: int) -> Array:
        return size * spread * rng.uniform(-1.0, 1.0, shape or None)

    geometry, gravity = pack_geometry(rig), pack_gravity(rig)
    body = pack_body(rig)
    nominal = (geometry.copy(), body.copy(), gravity.copy(), pack_fed_legs(rig))
    body[0] *= 1.0 + float(off(0.007))
    body[1:4] += off(0.002, 3)
    body[4:7] *= 1.0 + off(0.01, 3)
    if kind_code(rig) >= 2:
        joints = geometry[: 6 * n]
        joints += off(0.0002, len(joints))
    roll, pitch = off(0.001, 2)
    g = np.linalg.norm(gravity)
    gravity = g * np.array([math.sin(pitch), -math.sin(roll), -math.cos(pitch) * math.cos(roll)])
    legs = pack_legs(rig)
    legs *= 1.0 + off(0.02, *legs.shape)
    head = np.zeros(lay.HEADER)
    head[lay.H_KIND] = kind_code(rig)
    head[lay.H_STEP] = STEP_S
    head[lay.H_CYCLE] = rig.bus.cycle
    head[lay.H_RETIMED] = rig.bus.retimed
    head[lay.H_LINEAR] = rig.bus.interpolation != "hold"
    head[lay.H_PD] = any(a.law == "pd" for a in rig.actuators)
    head[lay.H_SETTLE] = SETTLE_S
    head[lay.H_FORCES] = run_mode(rig) == "force"
    head[lay.H_FORCE_LINEAR] = rig.bus.force_interpolation == "linear"
    head[lay.H_MODE_M] = size * rng.uniform(0.01, 0.025) * rig.mass.m
    head[lay.H_MODE_W] = 2.0 * math.pi * rng.uniform(22.0, 45.0)
    head[lay.H_MODE_D] = rng.uniform(0.08, 0.2)
    place = np.array(rig.mass.cog) + off(0.1, 3)
    head[lay.H_MODE_X : lay.H_MODE_Z + 1] = place
    imu = np.zeros(12)
    if rig.imu is not None:
        head[lay.H_BANDWIDTH] = 2.0 * math.pi * rig.imu.bandwidth * (1.0 + float(off(0.03)))
        imu[:3] = np.array(rig.imu.position) + off(0.001, 3)
        imu[3:] = turned(np.array(rig.imu.orientation), off(0.0015, 3)).ravel()
    world = World(
        rig, head, _actuators(rig, rng, size), (geometry, body, gravity), nominal, legs, imu,
        off(0.0002, n), off(0.0002, n), 1.0 + off(0.15, 2),
    )  # fmt: skip
    for a in rig.actuators:
        force = max(0.5 * rig.noise.force, 5e-4 * a.force_max)
        world.sensor(f"{a.name}.force").bias = float(off(force))
    if rig.imu is not None:
        for axis in "xyz":
            world.sensor(f"imu.gyro_{axis}").bias = float(off(0.6 * rig.noise.gyro))
            world.sensor(f"imu.accel_{axis}").bias = float(off(0.6 * rig.noise.accel))
    return world


def _actuators(rig: RigFile, rng: np.random.Generator, size: float) -> Array:
    act = np.zeros((lay.A_ROWS, len(rig.actuators)))
    bus = rig.bus
    for row in (
        lay.A_STRIBECK_V, lay.A_HYST_X, lay.A_HYST_N, lay.A_RIPPLE_P, lay.A_OWN_RIPPLE_P, lay.A_LEAD,
        lay.A_LEAD_P, lay.A_FORCE_SCALE, lay.O_SEAL_TAU, lay.O_DRIFT_TAU, lay.O_BUMP_W, lay.O_COG_P,
        lay.O_COG_L, lay.O_DERATE_TAU, lay.A_FRICTION_L,
    ):  # fmt: skip
        act[row] = 1.0

    def off(spread: float) -> float:
        return size * spread * float(rng.uniform(-1.0, 1.0))

    wander = TICK_DRIFT if rng.random() < 0.5 else 0.0
    for i, a in enumerate(rig.actuators):
        span = a.stroke[1] - a.stroke[0]
        load = max(a.effective_mass - a.reflected_mass, 0.4 * a.effective_mass)
        bend = 2.0 * math.pi * rng.uniform(150.0, 210.0)
        per_turn = getattr(a.transmission, "lead", None) or 0.02 * span
        for row, value in (
            (lay.A_MASS, max(a.reflected_mass * (1.0 + off(0.007)), 0.05 * a.effective_mass)),
            (lay.A_VISCOUS, a.viscous * (1.0 + off(0.07))),
            (lay.A_COULOMB, a.coulomb * (1.0 + off(0.07))),
            (lay.A_BRISTLE, 1.0 / (rng.uniform(6e-6, 1.8e-5) * max(span, 0.1) / 0.5)),
            (lay.A_FRICTION_V, size * rng.uniform(0.0, 0.08)),
            (lay.A_FRICTION_X, size * rng.uniform(0.0, 0.05)),
            (lay.A_FRICTION_L, span * rng.uniform(0.2, 0.8)),
            (lay.A_FRICTION_PHASE, rng.uniform(0.0, 6.28)),
            (lay.A_STIFFNESS, load * bend**2),
            (lay.A_DAMPING, 2.0 * rng.uniform(0.08, 0.15) * load * bend),
            (lay.A_OWN_RIPPLE_A, size * rng.uniform(0.05, 0.3) * rig.noise.force),
            (lay.A_OWN_RIPPLE_P, per_turn / rng.integers(2, 5)),
            (lay.A_OWN_RIPPLE_PHASE, rng.uniform(0.0, 6.28)),
            (lay.A_FORCE_LIMIT, a.force_max),
            (lay.A_FORCE_MAX, a.force_max),
            (lay.A_SPEED_LIMIT, a.velocity_max),
            (lay.A_SPEED_MAX, a.velocity_max),
            (lay.A_KP, a.position_gain * (1.0 + off(0.005))),
            (lay.A_KV, a.speed_gain * (1.0 + off(0.005))),
            (lay.A_KI, a.integral_gain * (1.0 + off(0.005))),
            (lay.A_KFV, a.velocity_ff),
            (lay.A_KFA, a.acceleration_ff),
            (lay.A_KFF, a.friction_ff),
            (lay.A_FF_VISCOUS, a.viscous),
            (lay.A_FF_COULOMB, a.coulomb),
            (lay.A_MEFF, a.effective_mass),
            (lay.A_CURRENT_W, 2.0 * math.pi * a.current_hz * rng.uniform(0.8, 1.2)),
            (lay.A_STATIC, a.static_ff if a.law != "cascade" else 0.0),
            (lay.A_COUNT, COUNT),
            (lay.A_SPEED_TAU, rng.uniform(2.6e-4, 4e-4)),
            (lay.A_PERIOD_P, bus.position_loop * (1.0 + off(wander))),
            (lay.A_HOME, a.home),
            (lay.A_PER_AMPERE, a.force_per_ampere or 1.0),
            (lay.A_LOWER, a.stroke[0]),
            (lay.A_UPPER, a.stroke[1]),
        ):
            act[row, i] = value
        act[lay.A_PERIOD_V, i] = act[lay.A_PERIOD_P, i] * bus.speed_loop / bus.position_loop
        if a.law == "pd":  # one loop, the fast one
            act[lay.A_PERIOD_P, i] = act[lay.A_PERIOD_V, i]
        act[lay.A_PHASE_P, i] = rng.uniform(0.0, bus.position_loop)
        act[lay.A_PHASE_V, i] = rng.uniform(0.0, bus.speed_loop)
    return act


def turned(angles: Array, small: Array) -> Array:
    """Rotation sensor -> platform of roll, pitch, yaw, turned by a small rotation vector of the sensor."""
    out = np.eye(3)
    for axis, angle in zip((2, 1, 0), angles[::-1], strict=True):
        out = out @ _about(axis, angle)
    size = float(np.linalg.norm(small))
    if size == 0.0:
        return out
    x, y, z = small / size
    K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.asarray(out @ (np.eye(3) + math.sin(size) * K + (1.0 - math.cos(size)) * K @ K))


def _about(axis: int, angle: float) -> Array:
    c, s = math.cos(angle), math.sin(angle)
    R = np.eye(3)
    p, q = (axis + 1) % 3, (axis + 2) % 3
    R[p, p], R[p, q], R[q, p], R[q, q] = c, -s, s, c
    return R
