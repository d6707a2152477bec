"""The acceleration that a rider feels along one coordinate, as the IMU measures it or the pose tells it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hil.config import RigFile
from hil.config.geometry import AxisGeometry
from hil.errors import IdentificationError
from hil.identify.frequency.channels import Channel, Sampled, channel
from hil.rigs.pack import DIRECTION
from hil.runs import Run

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

AXES: Final = {"surge": 0, "sway": 1, "heave": 2, "roll": 0, "pitch": 1, "yaw": 2}
"""Sensor axis of each coordinate of a platform: z up, and rotations about x, y, z."""


@dataclass(frozen=True, slots=True)
class Acceleration:
    """A channel whose `order`-th derivative is the acceleration: 0 accelerometer, 1 gyro, 2 pose."""

    channel: Channel
    order: int
    unit: str

    @property
    def source(self) -> str:
        """In words."""
        return ("accelerometer", "gyro, differentiated", "measured pose, differentiated twice")[
            self.order
        ]

    def harmonics(self, start_s: float, period_s: float, count: int) -> ComplexArray:
        """Complex amplitudes (count + 1,) of the acceleration over one period, mean set to zero."""
        x = self.channel.amplitudes(start_s, period_s, count)
        x = x * (2j * np.pi * np.arange(count + 1) / period_s) ** self.order
        x[0] = 0.0
        return np.asarray(x)


def acceleration(run: Run, rig: RigFile, coordinate: str) -> Acceleration:
    """Acceleration along `coordinate` while it moves alone: the IMU where the rig has one.

    Turned from the sensor's axes into the platform's. Gravity and bias are constant while the others
    rest, so they fall to the mean.
    """
    rotates = rig.rotates(coordinate)
    kind = "gyro" if rotates else "accel"
    unit = "rad/s²" if rotates else "m/s²"
    names = [f"imu.{kind}_{axis}" for axis in "xyz"]
    if rig.imu is None or any(n not in run.table.columns for n in names):
        return Acceleration(channel(run, rig, coordinate), 2, unit)
    axes = [channel(run, rig, name) for name in names]
    samples = [a for a in axes if isinstance(a, Sampled)]
    if any(len(a.t_s) != len(samples[0].t_s) for a in samples):
        raise IdentificationError(
            f"{run.path.name}: the three axes of imu.{kind} are not sampled together"
        )
    row = _direction(rig, coordinate) @ _turn(*rig.imu.orientation)
    value = row @ np.array([a.value for a in samples])
    merged = Sampled(f"imu.{kind} along {coordinate}", samples[0].unit, samples[0].t_s, value)
    return Acceleration(merged, 1 if rotates else 0, unit)


def _direction(rig: RigFile, coordinate: str) -> Array:
    """(3,) in the platform's axes: along which it moves, or about which it turns."""
    if isinstance(rig.geometry, AxisGeometry):
        return np.array(DIRECTION[rig.geometry.load])
    return np.asarray(np.eye(3)[AXES[coordinate]])


def _turn(roll: float, pitch: float, yaw: float) -> Array:
    """(3, 3): sensor axes in platform axes, R = Rz(yaw) Ry(pitch) Rx(roll)."""
    (cr, cp, cy), (sr, sp, sy) = np.cos([roll, pitch, yaw]), np.sin([roll, pitch, yaw])
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )
