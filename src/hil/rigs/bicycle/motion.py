"""A ride computed from its measured coordinates: everything that the sensors cannot see."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hil.errors import KinematicsError
from hil.rigs.bicycle.conditioning import Smooth
from hil.rigs.bicycle.parameters import Packed
from hil.rigs.bicycle.ride import simulate

Array = NDArray[np.float64]
RIGID: Final = (np.inf, np.inf, np.inf)
DEFLECTIONS: Final = ("fork travel", "rear tyre", "front tyre")


@dataclass(frozen=True, slots=True)
class Motion:
    """N samples every `dt_s`; coordinates as `derivation.COORDINATES`."""

    dt_s: float
    q: Array
    """(N, 12): m and rad."""
    qd: Array
    qdd: Array
    multipliers: Array
    """(N, 9): of the rows of D."""
    imu: Array
    """(N, 6): rate (rad/s) and specific force (m/s2) in the sensor frame."""
    normal: Array
    """(N, 2): normal force at rear and front wheel, N."""
    front_contact: Array
    """(N, 3): where the front wheel touches the road, m."""

    @property
    def t_s(self) -> Array:
        """(N,) from the first sample, s."""
        return np.asarray(self.dt_s * np.arange(len(self.q)))

    @property
    def steer_torque(self) -> Array:
        """(N,) of the rider between frame and fork, to the left positive, N m."""
        return -self.multipliers[:, 8]

    @property
    def drive_torque(self) -> Array:
        """(N,) at the rear wheel: pedals forward, brake backward, N m."""
        return -self.multipliers[:, 7]

    @property
    def lean_torque(self) -> Array:
        """(N,) from outside, to the right positive, N m: none acts on a free bicycle, so it shows what the
        model lacks (or a supporting hand)."""
        return -self.multipliers[:, 6]

    @property
    def tangential(self) -> Array:
        """(N, 2, 2): rear and front wheel; force along the wheel's heading and to its left, N."""
        forces = -self.multipliers[:, 2:6].reshape(-1, 2, 2)
        out = np.empty_like(forces)
        for w, yaw in enumerate((self.q[:, 2], self.front_heading)):
            c, s = np.cos(yaw), np.sin(yaw)
            out[:, w, 0] = c * forces[:, w, 0] + s * forces[:, w, 1]
            out[:, w, 1] = -s * forces[:, w, 0] + c * forces[:, w, 1]
        return out

    @property
    def front_heading(self) -> Array:
        """(N,) direction in which the front wheel rolls, rad in the base frame."""
        velocity = np.gradient(self.front_contact[:, :2], self.dt_s, axis=0)
        yaw = self.q[:, 2]
        forward = velocity[:, 0] * np.cos(yaw) + velocity[:, 1] * np.sin(yaw)
        aside = -velocity[:, 0] * np.sin(yaw) + velocity[:, 1] * np.cos(yaw)
        moving = np.abs(forward) > 0.05
        turned = np.arctan2(aside * np.sign(forward), np.abs(forward))
        out: Array = yaw + np.where(moving, turned, 0.0)
        return out

    @property
    def friction_demand(self) -> Array:
        """(N, 2): tangential over normal force at rear and front wheel; the road must give so much."""
        size = np.linalg.norm(self.multipliers[:, 2:6].reshape(-1, 2, 2), axis=2)
        out: Array = size / np.where(np.abs(self.normal) > 1e-9, self.normal, np.nan)
        return out

    @property
    def speed(self) -> Array:
        """(N,) of the rear contact point along the yaw direction, m/s."""
        yaw = self.q[:, 2]
        return self.qd[:, 0] * np.cos(yaw) + self.qd[:, 1] * np.sin(yaw)


def ride(
    bicycle: Packed,
    measured: Smooth,
    start: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0),
    spring: tuple[float, float, float] = RIGID,
    damper: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> Motion:
    """Simulate the ride whose lean, rear wheel and steer are `measured`.

    `start`: x, y (m), yaw and front wheel's angle at the first sample. `spring` (N/m), `damper` (N s/m):
    of DEFLECTIONS, infinite where rigid. KinematicsError names the sample at which no pose closes.
    """
    count = len(measured.angle)
    q, qd, qdd = (np.zeros((count, 12)) for _ in range(3))
    lam, imu, force = np.zeros((count, 9)), np.zeros((count, 6)), np.zeros((count, 5))
    told = tuple(
        np.ascontiguousarray(a) for a in (measured.angle, measured.rate, measured.acceleration)
    )
    parts = (
        bicycle.p, bicycle.body, bicycle.extra, bicycle.sensor, bicycle.encoder_on_frame
    )  # fmt: skip
    springs = (np.array(spring, dtype=float), np.array(damper, dtype=float))
    broke = simulate(
        parts,
        measured.dt_s,
        told,
        np.array(start, dtype=float),
        springs,
        (q, qd, qdd, lam, imu, force),
    )
    if broke >= 0:
        lean, _, steer = measured.angle[broke]
        raise KinematicsError(
            f"at {broke * measured.dt_s:.2f} s the bicycle cannot stand with lean {lean:.3f} and steer "
            f"{steer:.3f} rad: degrees for radians, swapped channels, or another bicycle's rig file?"
        )
    return Motion(measured.dt_s, q, qd, qdd, lam, imu, force[:, :2], force[:, 2:])
