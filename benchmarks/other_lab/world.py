"""A healthy rig of this lab: the rig file's rig with the small differences that every built one has."""

from __future__ import annotations

import copy
import math
from dataclasses import dataclass, field

import numpy as np

from benchmarks.other_lab import layout as lay
from benchmarks.other_lab.mechanism import AXIS, MOTORCYCLE, STEWART

KINDS = {"axis_1dof": AXIS, "motorcycle_3dof": MOTORCYCLE, "stewart_6dof": STEWART}
TRANSMISSION = {"axis": (5e7, 9e7), "leg1": (5e7, 9e7), "leg2": (5e7, 9e7), "slide": (3e7, 5e7)}
HEXAPOD_LEG = (8e7, 1.3e8)
"""Stiffness of a healthy transmission, N/m: its wind-up stays below what is measured."""


@dataclass
class Sensor:
    """What is wrong with one signal's sensor."""

    bias: float = 0.0
    scale: float = 1.0
    latency_s: float = 0.0
    step: float = 0.0


@dataclass
class Setup:
    """All numbers of one rig on one day; effects change a copy."""

    act: np.ndarray
    glob: np.ndarray
    joints: np.ndarray
    neutral: np.ndarray
    body: np.ndarray
    legs: np.ndarray
    grav: np.ndarray
    setpoint_delay: np.ndarray
    answer_delay_s: float
    misalignment: np.ndarray
    sensors: dict[str, Sensor] = field(default_factory=dict)
    clock_imu: float = 0.0
    clock_drives: float = 0.0
    lost_setpoints: float = 0.0
    lost_answers: float = 0.0
    stale_share: float = 0.0
    bang_m: float = 0.0
    bang_at: int = 0
    stall_s: float = 0.0

    def copy(self):
        """An independent copy."""
        return copy.deepcopy(self)

    def sensor(self, name):
        """The sensor of a signal, made if need be."""
        return self.sensors.setdefault(name, Sensor())


def _nominal_joints(rig):
    g = rig.geometry
    kind = KINDS[rig.kind]
    if kind == AXIS:
        return np.zeros((1, 2, 3)), np.zeros(3)
    if kind == STEWART:
        return np.stack([np.array(g.base), np.array(g.cabin)], axis=1).astype(float), np.array(
            [0.0, 0.0, g.height]
        )
    joints = np.zeros((3, 2, 3))
    joints[0, 1, 1], joints[1, 1, 1] = g.l, -g.l
    joints[2] = (-g.L, 0.0, g.h), (-g.l3, 0.0, -g.h3)
    return joints, np.zeros(3)


def lead_of(actuator):
    """Travel a motor turn, m."""
    tr = actuator.transmission
    if tr is None:
        return 0.005
    return tr.lead if tr.type == "screw" else 2.0 * math.pi * tr.pinion_radius / tr.gear


class World:
    """One built rig: `setup` is its healthy state, drawn from `rng`."""

    def __init__(self, rig, rng):
        self.rig = rig
        self.kind = KINDS[rig.kind]
        self.nominal_joints, self.nominal_neutral = _nominal_joints(rig)
        self.imu_r = np.array(rig.imu.position, dtype=float)
        self.noise_scale = {
            q: float(rng.uniform(0.92, 1.08)) for q in ("position", "force", "gyro", "accel")
        }
        self.setup = self._draw(rng)

    def _draw(self, rng):
        rig = self.rig
        n = len(rig.actuators)

        def near(spread, size=None):
            return 1.0 + rng.uniform(-spread, spread, size)

        act = np.zeros((lay.ACT_ROWS, n))
        for row, value in lay.NEUTRAL.items():
            act[row] = value
        law, shape = int(rng.integers(3)), float(rng.choice((0.0, 1.0, 1.4, 2.0)))
        for i, a in enumerate(rig.actuators):
            coulomb = a.coulomb * near(0.1)
            k = rng.uniform(*TRANSMISSION.get(a.name, HEXAPOD_LEG))
            inverse = 1.0 / a.reflected_mass + 1.0 / max(a.effective_mass - a.reflected_mass, 1.0)
            presliding = {
                lay.LUGRE: coulomb / rng.uniform(6e-6, 1.5e-5),
                lay.MAXWELL: rng.uniform(2e-6, 5e-6),
                lay.TANH: rng.uniform(2e-4, 5e-4),
            }[law]
            for row, value in (
                (lay.MR, a.reflected_mass * near(0.02)), (lay.VIS, a.viscous * near(0.1)),
                (lay.COUL_P, coulomb * near(0.01)), (lay.COUL_N, coulomb * near(0.01)),
                (lay.STAT, coulomb * rng.uniform(0.02, 0.05)), (lay.VSTR, rng.uniform(0.008, 0.03)),
                (lay.SHAPE, shape), (lay.LAW, law), (lay.SIG0, presliding),
                (lay.SIG1, 0.6 * math.sqrt(presliding * a.reflected_mass) if law == lay.LUGRE else 0.0),
                (lay.KT, k), (lay.DT, 2.0 * rng.uniform(0.08, 0.15) * math.sqrt(k / inverse)),
                (lay.RIP_A, rng.uniform(0.1, 0.25) * rig.noise.force), (lay.RIP_P, lead_of(a) / 8),
                (lay.RIP_PH, rng.uniform(0.0, 2.0 * math.pi)), (lay.KF, near(0.01)),
                (lay.KP, a.position_gain), (lay.KV, a.speed_gain), (lay.KI, a.integral_gain),
                (lay.VMAX, a.velocity_max), (lay.FMAX, a.force_max),
                (lay.CUR_W, 2.0 * math.pi * a.current_hz * near(0.1)), (lay.CUR_Z, rng.uniform(0.7, 0.85)),
                (lay.HOME, a.home),
            ):  # fmt: skip
                act[row, i] = value
        glob = np.zeros(lay.GLOBALS)
        m = rig.mass.m * near(0.025)
        side = 0.03 * m
        glob[lay.CYCLE], glob[lay.SUBSTEPS] = rig.bus.cycle, 8
        glob[lay.TICK] = rig.bus.speed_loop * (1.0 + rng.normal(0.0, 1.5e-5))
        glob[lay.SIDE_M], glob[lay.SIDE_W], glob[lay.SIDE_Z] = (
            side,
            2.0 * math.pi * rng.uniform(38, 60),
            0.05,
        )
        body = np.zeros(7)
        body[0] = m - side
        body[1:4], body[4:] = rig.mass.cog, np.diag(np.array(rig.mass.inertia)) * near(0.025, 3)
        joints, legs = self.nominal_joints.copy(), np.zeros((n, 4))
        if self.kind != AXIS:
            body[1:4] += rng.normal(0.0, 7e-4, 3)
            joints += rng.normal(0.0, 5e-5, joints.shape)
        if self.kind == STEWART:
            legs[:] = rng.uniform(1.0, 2.0), 0.4, rng.uniform(0.6, 1.2), 0.3
        tilt = rng.normal(0.0, 3e-4, 2)
        return Setup(
            act=act, glob=glob, joints=joints, neutral=self.nominal_neutral.copy(), body=body, legs=legs,
            grav=rig.mass.gravity * np.array([tilt[1], -tilt[0], -1.0]),
            setpoint_delay=np.full(n, max(rig.bus.setpoint_delay + rng.uniform(-1.5e-4, 2.5e-4), 1e-4)),
            answer_delay_s=rig.bus.answer_delay + rng.uniform(-2e-4, 2e-4),
            misalignment=rng.normal(0.0, 8e-4, 3),
        )  # fmt: skip
