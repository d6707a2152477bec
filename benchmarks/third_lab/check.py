"""Checks of the world against a rigid ideal: `python -m benchmarks.third_lab.check axis motorcycle stewart`.

Inverse dynamics of a massless-legged rigid platform, written apart from the engine, predict forces and IMU
from the motion that the engine made. What they leave, in sigmas of the rig file's noise, is elasticity,
presliding, ripple and, for a commissioned specimen, its scatter.
"""

from __future__ import annotations

import sys

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.signal import savgol_filter
from scipy.spatial.transform import Rotation

from benchmarks.third_lab import columns as c
from benchmarks.third_lab.commission import commission
from benchmarks.third_lab.motions import FAMILIES, cue
from benchmarks.third_lab.plant import Plant, nominal
from benchmarks.third_lab.pose import lengths, platform, wrench_map
from benchmarks.third_lab.world import Chance, Trace, run
from hil.configfile import find_rig_file, load_rig

STEP = 10
"""Ticks between the instants that are looked at."""


def ideal_forces(ideal: Plant, positions: np.ndarray, dt: float) -> tuple[np.ndarray, np.ndarray]:
    """Forces (n, k) and IMU (6, k) of the rigid nominal rig for `positions` (n, ticks) every STEP ticks."""
    rig = ideal.rig
    smooth, rate, acc = (
        savgol_filter(positions, 61, 4, deriv=d, delta=dt, axis=1)[:, ::STEP] for d in (0, 1, 2)
    )
    t = np.arange(smooth.shape[1]) * dt * STEP
    origin, turned = _forward(ideal, smooth.T)
    spline = CubicSpline(t, origin)
    vectors = _continuous(turned)
    omega, alpha = _spin(t, vectors, turned)
    body = turned.as_matrix()
    arm = np.einsum("kij,j->ki", body, ideal.cog)
    centre = spline(t, 2) + np.cross(alpha, arm) + np.cross(omega, np.cross(omega, arm))
    inertia = np.einsum("kij,jl,kml->kim", body, ideal.inertia, body)
    moment = np.einsum("kij,kj->ki", inertia, alpha) + np.cross(
        omega, np.einsum("kij,kj->ki", inertia, omega)
    )
    need = np.concatenate([ideal.mass * (centre - ideal.gravity), moment], axis=1)
    _, along = lengths(ideal, origin, turned)
    members = np.linalg.solve(wrench_map(ideal, along, turned), need[:, :, None])[:, :, 0]
    load = members[:, ideal.actuated >= 0].T
    a = ideal.act
    own = a[:, [c.COULOMB_POS]] * np.tanh(rate / 1e-3)
    force = (
        load + a[:, [c.REFLECTED]] * acc + (a[:, [c.VISCOUS]] + a[:, [c.LOAD_VISCOUS]]) * rate + own
    )
    at = np.einsum("kij,j->ki", body, ideal.imu_at)
    felt = (
        spline(t, 2)
        + np.cross(alpha, at)
        + np.cross(omega, np.cross(omega, at))
        + [0, 0, rig.mass.gravity]
    )
    inside = body.transpose(0, 2, 1)
    imu = np.concatenate(
        [np.einsum("kij,kj->ik", inside, omega), np.einsum("kij,kj->ik", inside, felt)]
    )
    return force, imu


def _forward(ideal: Plant, wanted: np.ndarray) -> tuple[np.ndarray, Rotation]:
    """Origin and attitude for actuator positions (k, n), guides at zero, by Newton's method from neutral."""
    k = len(wanted)
    aim = np.zeros((k, 6))
    aim[:, ideal.actuated >= 0] = wanted
    origin, turned = platform(
        ideal.rig.kind, ideal.rig.geometry, np.zeros((k, len(ideal.rig.coordinates)))
    )
    for _ in range(8):
        length, along = lengths(ideal, origin, turned)
        arms = np.einsum("kij,mj->kmi", turned.as_matrix(), ideal.cabin)
        rows = np.concatenate([along, np.cross(arms, along)], axis=2)
        step = np.linalg.solve(rows, (aim - length)[:, :, None])[:, :, 0]
        origin, turned = origin + step[:, :3], Rotation.from_rotvec(step[:, 3:]) * turned
    return origin, turned


def _continuous(turned: Rotation) -> np.ndarray:
    return turned.as_matrix().reshape(-1, 9)


def _spin(t: np.ndarray, flat: np.ndarray, turned: Rotation) -> tuple[np.ndarray, np.ndarray]:
    """Angular rate and acceleration in the base frame from the derivative of the matrices."""
    slope = CubicSpline(t, flat)(t, 1).reshape(-1, 3, 3)
    tilde = np.einsum("kij,klj->kil", slope, turned.as_matrix())
    omega = np.stack([tilde[:, 2, 1], tilde[:, 0, 2], tilde[:, 1, 0]], axis=1)
    return omega, CubicSpline(t, omega)(t, 1)


def report(name: str) -> None:
    """Print what the ideal leaves of a nominal and of a commissioned rig, family by family."""
    ideal = nominal(load_rig(find_rig_file(name)))
    for family in FAMILIES:
        rng = np.random.default_rng(7)
        motion = cue(family, rng, ideal, 20.0)
        chance = Chance.draw(rng, ideal, len(motion))
        for label, plant in (("nominal", ideal), ("specimen", commission(ideal, rng)[0])):
            trace = run(plant, ideal, motion, chance)
            print(f"{name} {family:10} {label:9} {_line(ideal, trace)}")


def _line(ideal: Plant, trace: Trace) -> str:
    noise = ideal.rig.noise
    force, imu = ideal_forces(ideal, trace.position, trace.dt)
    keep = slice(40, -80)
    seen = savgol_filter(trace.force, 61, 4, axis=1)[:, ::STEP]
    f = np.sqrt(np.mean((seen - force)[:, keep] ** 2, axis=1)) / noise.force
    late = round(np.sqrt(2.0) / (2.0 * np.pi * ideal.rig.imu.bandwidth) / trace.dt)
    felt = savgol_filter(np.roll(trace.imu, -late, axis=1), 61, 4, axis=1)[:, ::STEP]
    g = np.sqrt(np.mean((felt - imu)[:, keep] ** 2, axis=1))
    ticks = np.arange(trace.position.shape[1]) * trace.dt
    lag = [
        _lag(ticks, x, trace.sent_s, s) * 1e3
        for x, s in zip(trace.position, trace.setpoint.T, strict=True)
    ]
    return (
        f"force {np.round(f, 2)} gyro {np.round(g[:3] / noise.gyro, 2)} "
        f"accel {np.round(g[3:] / noise.accel, 2)} lag {np.round(lag, 2)} ms"
    )


def _lag(ticks: np.ndarray, x: np.ndarray, sent: np.ndarray, aim: np.ndarray) -> float:
    """Delay (s) of `x` behind the line through setpoints that fits best, to first order."""
    line = np.interp(ticks, sent, aim)
    rate = np.gradient(line, ticks)
    return float(np.sum((line - x) * rate) / np.sum(rate * rate))


if __name__ == "__main__":
    for argument in sys.argv[1:]:
        report(argument)
