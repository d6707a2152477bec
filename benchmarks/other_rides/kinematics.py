"""How a bicycle moves whose lean, steer and rolling are told: pose, yaw rate, and what an IMU on it feels.

Axes: x forward, y left, z up, in a frame that stands under the rear contact and turns with the yaw. Lean
to the right, steer to the left, nose down are positive. Three geometric facts are used and no more: the
front wheel's lowest point stands on the road (that gives the pitch), neither wheel's contact moves across
its own track (that gives the yaw rate), and rates are differences of poses.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from benchmarks.other_rides.frames import column, cross, dot, rate, turn_x, turn_y, turn_z
from hil.config import BicycleFile

Array = NDArray[np.float64]

UP: Final = column(0.0, 0.0, 1.0)
CLOSINGS: Final = 8
"""Newton steps on the pitch; each leaves about a hundredth."""


@dataclass(frozen=True, slots=True)
class Shape:
    """What of a bicycle decides its kinematics; m and rad."""

    tilt: float
    wheelbase: float
    head: Array
    """(3, 1): a point of the steer axis, from the rear wheel's centre."""
    front: Array
    """(3, 1): the front wheel's centre, steered straight."""
    rear_radius: float
    front_radius: float
    imu: Array
    """(3, 1): place of the IMU."""
    gravity: float

    @staticmethod
    def of(rig: BicycleFile, rear_scale: float = 1.0, front_scale: float = 1.0) -> Shape:
        """The frame of the rig file on wheels so many times as large."""
        g = rig.geometry
        assert rig.imu is not None
        return Shape(
            g.tilt,
            g.wheelbase,
            column(g.wheelbase + g.trail, 0.0, -g.R),
            column(g.wheelbase, 0.0, g.front_radius - g.R),
            g.R * rear_scale,
            g.front_radius * front_scale,
            column(*rig.imu.position),
            rig.mass.gravity,
        )


@dataclass(frozen=True, slots=True)
class Course:
    """What is told, (N,) each or a number: `speed` of the rear contact along its track, m/s."""

    dt_s: float
    lean: Array
    steer: Array
    """Where the front wheel points: what the encoder reads but for flex and play."""
    speed: Array
    rear_road: Array | float = 0.0
    front_road: Array | float = 0.0
    rear_squash: Array | float = 0.0
    """Deflection of the tyre, m."""
    front_squash: Array | float = 0.0
    travel: Array | float = 0.0
    """Of the fork, compressed positive, m."""
    rear_aside: Array | float = 0.0
    """Speed of the rear contact to the left of the frame's plane, m/s."""
    front_aside: Array | float = 0.0


class Motion:
    """The motion that follows from a course."""

    def __init__(self, shape: Shape, course: Course) -> None:
        self.shape, self.course, self.dt_s = shape, course, course.dt_s
        self.axle = UP * course.rear_road + turn_x(
            course.lean, UP * (shape.rear_radius - course.rear_squash)
        )
        self.pitch = self._closed_pitch()
        front, normal = self._front(self.pitch)
        steep = np.sqrt(1.0 - normal[2] ** 2)
        self.front_axle, self.wheel_normal = front, normal
        self.down = (normal[2] * normal - UP) / steep
        self.contact = front + (shape.front_radius - course.front_squash) * self.down
        self.track = np.stack([normal[1], -normal[0], 0.0 * steep]) / steep
        across = np.stack([-self.track[1], self.track[0], 0.0 * steep])
        self.rolling = np.stack([course.speed, 0.0 * steep + course.rear_aside, 0.0 * steep])
        told = dot(across, self.rolling + rate(self.contact, self.dt_s))
        turned = across[1] * self.contact[0] - across[0] * self.contact[1]
        self.yaw_rate = (course.front_aside - told) / turned

    def frame(self, v: Array, pitch: Array | None = None) -> Array:
        """From axes of the rear frame."""
        return turn_x(self.course.lean, turn_y(self.pitch if pitch is None else pitch, v))

    def body(self, v: Array) -> Array:
        """To axes of the rear frame."""
        return turn_y(-self.pitch, turn_x(-self.course.lean, v))

    def fork(self, v: Array) -> Array:
        """From axes of the fork to those of the rear frame."""
        tilt = self.shape.tilt
        return turn_y(-tilt, turn_z(self.course.steer, turn_y(tilt, v)))

    def unfork(self, v: Array) -> Array:
        """From axes of the rear frame to those of the fork."""
        tilt = self.shape.tilt
        return turn_y(-tilt, turn_z(-self.course.steer, turn_y(tilt, v)))

    def place(self, v: Array) -> Array:
        """A point of the rear frame, (3, N) from the rear contact."""
        return self.axle + self.frame(v)

    def velocity(self, place: Array) -> Array:
        """Of a point that is there, m/s."""
        turning = np.stack([-self.yaw_rate * place[1], self.yaw_rate * place[0], 0.0 * place[2]])
        return rate(place, self.dt_s) + self.rolling + turning

    def absolute_rate(self, v: Array) -> Array:
        """Derivative of a vector as one sees it who does not turn."""
        turning = np.stack([-self.yaw_rate * v[1], self.yaw_rate * v[0], 0.0 * v[2]])
        return rate(v, self.dt_s) + turning

    def spin(self) -> Array:
        """Angular velocity of the rear frame, (3, N) in the frame that yaws."""
        still = 0.0 * self.yaw_rate
        pitching = np.stack([still, rate(self.pitch, self.dt_s), still])
        leaning = np.stack([rate(self.course.lean, self.dt_s), still, self.yaw_rate])
        return leaning + turn_x(self.course.lean, pitching)

    def imu(self) -> Array:
        """(6, N): rates (rad/s) and specific force (m/s2) in axes of the rear frame."""
        moving = self.velocity(self.place(self.shape.imu))
        felt = self.absolute_rate(moving) + self.shape.gravity * UP
        return np.vstack([self.body(self.spin()), self.body(felt)])

    def front_spin(self) -> Array:
        """(N,): how fast the front wheel turns in the fork; angular velocity of the fork is `fork_spin`."""
        sliding = self.velocity(self.front_axle) + cross(
            self.fork_spin(), self.contact - self.front_axle
        )
        return dot(self.track, sliding) / self.shape.front_radius

    def fork_spin(self) -> Array:
        """Angular velocity of the fork, (3, N)."""
        axis = turn_y(-self.shape.tilt, UP)
        return self.spin() + self.frame(axis) * rate(self.course.steer, self.dt_s)

    def _front(self, pitch: Array) -> tuple[Array, Array]:
        """Centre of the front wheel and the normal of its plane (to the left)."""
        s = self.shape
        sprung = s.front - s.head + turn_y(-s.tilt, UP) * self.course.travel
        centre = self.axle + self.frame(s.head + self.fork(sprung), pitch)
        return centre, self.frame(self.fork(column(0.0, 1.0, 0.0)), pitch)

    def _closed_pitch(self) -> Array:
        pitch = np.zeros_like(self.course.lean)
        radius = self.shape.front_radius - self.course.front_squash
        for _ in range(CLOSINGS):
            centre, normal = self._front(pitch)
            above = centre[2] - radius * np.sqrt(1.0 - normal[2] ** 2) - self.course.front_road
            pitch = pitch + above / (self.shape.wheelbase * np.cos(self.course.lean))
            if np.abs(above).max() < 1e-13:
                break
        return pitch
