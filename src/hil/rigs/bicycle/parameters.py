"""The numbers of one bicycle as flat arrays for compiled code, and whether bodies like that can exist.

`p` (13,) as `equations.py` says; `body` (4, 5): m, Ixx, Iyy, Izz, Ixz of bodies 2..5 (kg, kg m2), z-up
axes; `extra` (5,): gravity, c_v, and the IMU's x, y, z from the centre of the rear wheel.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hil.config.bicycle import BicycleFile
from hil.rigs.bicycle.rider import impossible_rider

Array = NDArray[np.float64]

RADIUS_REAR, RADIUS_FRONT, ROLLING = 0, 1, 2
G3_UP, G4_UP = 8, 10
BODIES = ("rear wheel", "rear frame with rider", "handlebar and fork", "front wheel")


@dataclass(frozen=True, slots=True)
class Packed:
    """One bicycle for compiled code. Arrays are read-only; `scaled` makes another."""

    p: Array
    """(13,) geometry."""
    body: Array
    """(4, 5) masses and inertias."""
    extra: Array
    """(5,) gravity, drag, IMU's place."""
    sensor: Array
    """(3, 3) IMU axes in the axes of body 3: v_sensor = sensor @ v_body."""
    encoder_on_frame: bool

    def __post_init__(self) -> None:
        for array in (self.p, self.body, self.extra, self.sensor):
            array.setflags(write=False)  # of one type too: compiled code is compiled once

    def scaled(
        self, rear: float = 1.0, front: float = 1.0, slip: float = 0.0, frame: float = 1.0
    ) -> Packed:
        """With wheels `rear` and `front` times as large, rear slipping by a share more; the frame stays as it
        is and goes up by `frame` of what the rear wheel grows."""
        p = self.p.copy()
        p[RADIUS_REAR] *= 1.0 + frame * (rear - 1.0)
        p[RADIUS_FRONT] *= front
        p[ROLLING] *= rear * (1.0 - slip)
        return Packed(p, self.body, self.extra, self.sensor, self.encoder_on_frame)


def pack(rig: BicycleFile) -> Packed:
    """`rig` as arrays."""
    g, m = rig.geometry, rig.mass
    r_r, r_f = g.R, g.front_radius
    p = [
        r_r, r_f, r_r, math.sin(g.tilt), math.cos(g.tilt),
        g.wheelbase + g.trail, -r_r, m.G3[0], m.G3[2], m.G4[0], m.G4[2], g.wheelbase, r_f - r_r,
    ]  # fmt: skip
    body = [
        [m.m[0], *m.I2, 0.0],
        [m.m[1], *m.I3],
        [m.m[2], *m.I4],
        [m.m[3], *m.I5, 0.0],
    ]
    place = (0.0, 0.0, 0.0) if rig.imu is None else rig.imu.position
    turn = (0.0, 0.0, 0.0) if rig.imu is None else rig.imu.orientation
    return Packed(
        np.array(p),
        np.array(body),
        np.array([m.gravity, rig.aero, *place]),
        rotation(*turn).T.copy(),
        rig.sensors.encoder_on_frame,
    )


def rotation(roll: float, pitch: float, yaw: float) -> Array:
    """R = Rz(yaw) Ry(pitch) Rx(roll): sensor axes in body axes."""
    cr, sr, cp, sp, cy, sy = (f(a) for a in (roll, pitch, yaw) for f in (math.cos, math.sin))
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


def impossible_bodies(rig: BicycleFile) -> list[str]:
    """A sentence for each body whose inertia no distribution of mass has.

    Principal moments obey the triangle inequality: none is larger than the sum of the others.
    """
    m = rig.mass
    out = []
    for name, key, (xx, yy, zz, xz) in zip(
        BODIES,
        ("I2", "I3", "I4", "I5"),
        ((*m.I2, 0.0), m.I3, m.I4, (*m.I5, 0.0)),
        strict=True,
    ):
        low, high = np.linalg.eigvalsh(np.array([[xx, xz], [xz, zz]]))
        moments = sorted((float(low), yy, float(high)))
        if moments[0] <= 0.0:
            out.append(
                f"mass.{key}: {name}: a principal moment of inertia is {moments[0]:.4g} kg·m², not above 0"
            )
        elif moments[2] > (moments[0] + moments[1]) * (1.0 + 1e-9):
            a, b, c = moments
            out.append(
                f"mass.{key}: {name}: principal moments {a:.4g} + {b:.4g} < {c:.4g} kg·m²: no body has "
                "such an inertia (triangle inequality); results follow the numbers as given"
            )
    rider = impossible_rider(rig)
    return out if rider is None else [*out, rider]


def reduced_inertia(rig: BicycleFile) -> float:
    """Of the whole bicycle at the rear wheel, kg m2: I2y + I5y (R/R_front)² + (sum m) R².

    Source: "Validation of multibody modeling and simulation using an instrumented bicycle", eq (33);
    Table 1 gives 11.708, the 12.17 in print does not follow from it [V].
    """
    g, m = rig.geometry, rig.mass
    return m.I2[1] + m.I5[1] * (g.R / g.front_radius) ** 2 + sum(m.m) * g.R**2
