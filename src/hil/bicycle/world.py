"""A ride that nobody rode: the bicycle with all its gaps moves under a rider's torques, finely stepped."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hil.bicycle.effects import RideEffects
from hil.bicycle.path import SPACING_M, Path, speed_profile
from hil.config import BicycleFile
from hil.errors import KinematicsError
from hil.rigs.bicycle.forward import simulate_forward
from hil.rigs.bicycle.parameters import pack
from hil.rigs.bicycle.ride import static_load

Array = NDArray[np.float64]

STEP_S: Final = 0.001
"""Tyres on a front wheel of 2 kg ring at 40 Hz: forty steps a period."""
_OFFSET_GAIN, _HEADING_GAIN, _POLE = 0.01, 0.2, 4.0
_STEER_STIFFNESS, _STEER_DAMPING, _PREVIEW_S = 60.0, 6.0, 0.6
_ROAD_HZ: Final = (0.15, 4.0)
"""Waves of an uneven road, per metre: from 7 m, above which a rider feels hills, to 0.25 m, a tyre's."""


@dataclass(frozen=True, slots=True)
class RideTruth:
    """What really happened, every STEP_S; the model's coordinates, with all effects in place."""

    t_s: Array
    q: Array
    """(N, 12)."""
    qd: Array
    imu: Array
    """(N, 6) at the sensor, before its filter."""
    torques: Array
    """(N, 3): lean (a foot on the ground), drive and steer torque, N m."""
    rider_lean: Array
    """(N,) of the upper body against the frame, rad."""


def ride_along(
    rig: BicycleFile,
    path: Path,
    seed: int = 0,
    *,
    cruise: float = 5.0,
    turning: float = 3.6,
    road_m: float = 0.0,
    restless: float = 0.004,
    vigour: float = 1.0,
) -> RideTruth:
    """Ride the bicycle, with its file's effects, along `path`; cruise and turning speed in m/s.

    `vigour`: of pulling away and braking. `road_m`: standard deviation of the road's height, m. `restless`:
    how far the rider strays from the path's curvature, 1/m. KinematicsError where it falls.
    """
    rng = np.random.default_rng(seed)
    effects = RideEffects.of(rig)
    values = effects.values
    bicycle = effects.bicycle(pack(rig))
    fork, tyre = "bicycle.front_suspension", "bicycle.tyre_compliance"
    spring = np.array([values[f"{fork}.stiffness"], *[values[f"{tyre}.stiffness"]] * 2])
    damper = np.array([values[f"{fork}.damping"], *[values[f"{tyre}.damping"]] * 2])
    speeds = speed_profile(path, STEP_S, cruise, turning, vigour=vigour)
    count = len(speeds)
    rows = path.rows.copy()
    rows[:, 3] += restless * _smooth_noise(rng, len(rows), round(4.0 / SPACING_M))
    road = road_m * _road(rng, len(rows)) if road_m > 0.0 else np.zeros(1)
    world = (
        spring,
        damper,
        static_load(bicycle.p, bicycle.body, bicycle.extra, False),
        _rider(rig, values),
        road,
        SPACING_M,
    )
    gains = np.array(
        [SPACING_M, _OFFSET_GAIN, _HEADING_GAIN, _POLE, _STEER_STIFFNESS, _STEER_DAMPING,
         sum(rig.mass.m) * rig.geometry.R, _PREVIEW_S]
    )  # fmt: skip
    out = (np.zeros((count, 12)), np.zeros((count, 12)), np.zeros((count, 6)), np.zeros((count, 4)))
    parts = (bicycle.p, bicycle.body, bicycle.extra, bicycle.sensor)
    fell = simulate_forward(parts, world, rows, speeds, gains, STEP_S, out)
    if fell >= 0:
        raise KinematicsError(f"{rig.name}: the simulated rider fell after {fell * STEP_S:.1f} s")
    t = np.asarray(STEP_S * np.arange(count))
    return RideTruth(t, out[0], out[1], out[2], out[3][:, :3], out[3][:, 3])


def _rider(rig: BicycleFile, values: Mapping[str, float]) -> Array:
    """(8,) as `forward.accelerate` wants it; mass 0 where the rider does not move."""
    name = "bicycle.rider_motion"
    stiffness, gain = values[f"{name}.stiffness"], values[f"{name}.gain"]
    if not np.isfinite(stiffness):
        stiffness = 2e5 if gain else 0.0  # held as by a stiff back, leaning as told
    moving = rig.rider.mass if stiffness else 0.0
    up = rig.rider.pivot[2] + rig.geometry.R
    return np.array(
        [
            moving,
            up,
            rig.rider.height,
            rig.rider.inertia,
            stiffness,
            values[f"{name}.damping"],
            gain,
            rig.rider.pivot[0],
        ]
    )


def _smooth_noise(rng: np.random.Generator, count: int, width: int) -> Array:
    """Noise of unit variance that changes over `width` samples."""
    window = np.hanning(2 * width + 1)
    noise = np.convolve(rng.standard_normal(count + 2 * width), window, "valid")
    return np.asarray(noise / np.sqrt(np.sum(window**2)))


def _road(rng: np.random.Generator, count: int) -> Array:
    """Heights of an even-tempered road, unit variance: power falls with the square of the wave number."""
    per_m = np.geomspace(*_ROAD_HZ, 60)
    size = np.sqrt(np.gradient(per_m)) / per_m
    phase = rng.uniform(0.0, 2.0 * np.pi, len(per_m))
    s = SPACING_M * np.arange(count)
    waves = size[:, None] * np.sin(2.0 * np.pi * per_m[:, None] * s + phase[:, None])
    height = waves.sum(axis=0)
    ease = np.clip(s / 2.0, 0.0, 1.0)
    return np.asarray(ease * height / np.sqrt(0.5 * np.sum(size**2)))
