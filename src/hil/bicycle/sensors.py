"""The bicycle's sensors: what they make of the truth, and the truth that their answers stand for."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.signal import butter, sosfilt, sosfilt_zi

from hil.config import BicycleFile
from hil.config.bicycle import SIGNALS, Sensors
from hil.rigs.bicycle.parameters import rotation
from hil.signals import IMU_QUANTITIES

Array = NDArray[np.float64]

Series = tuple[Array, Array]
"""Instants and values."""

IMU_SIGNALS: Final = tuple(f"imu.{q}" for q in IMU_QUANTITIES)


@dataclass(frozen=True, slots=True)
class Sensor:
    """One signal's effects: answer(t) = scale · truth(t − delay) + offset, rounded to `step`."""

    offset: float = 0.0
    scale: float = 1.0
    delay_s: float = 0.0
    step: float = 0.0

    @staticmethod
    def of(signal: str, values: Mapping[str, float]) -> Sensor:
        """Of parameters by name; what stands at `imu` holds for each of its signals besides its own."""
        places = (signal, "imu") if signal.startswith("imu.") else (signal,)

        def at(effect: str) -> list[float]:
            return [values[f"{place}.{effect}"] for place in places]

        return Sensor(
            sum(at("sensor_bias.offset")),
            float(np.prod(at("sensor_scale.scale"))),
            sum(at("sensor_latency.delay")),
            max(at("sensor_quantisation.step")),
        )

    def answer(self, t_s: Array, truth: Array, at_s: Array) -> Array:
        """Answers at `at_s` for a truth known at t_s."""
        out = self.scale * np.interp(at_s - self.delay_s, t_s, truth) + self.offset
        return np.asarray(np.round(out / self.step) * self.step) if self.step > 0.0 else out

    def truth(self, t_s: Array, answers: Array) -> Array:
        """The truth at t_s that answers at t_s stand for; ends are held."""
        if self.delay_s != 0.0:
            answers = np.interp(t_s + self.delay_s, t_s, answers)
        return np.asarray((answers - self.offset) / self.scale)


def misaligned(imu: Array, values: Mapping[str, float]) -> Array:
    """(N, 6) as a sensor turned by the misalignment reads it."""
    turn = [values[f"imu.sensor_misalignment.{c}"] for c in "xyz"]
    if not any(turn):
        return imu
    R = rotation(*turn)
    return np.hstack([imu[:, :3] @ R, imu[:, 3:] @ R])


def through_filter(imu: Array, rig: BicycleFile, dt_s: float) -> Array:
    """(N, 6) through the sensor's own low-pass, second-order Butterworth, begun at rest."""
    if rig.imu is None or rig.imu.bandwidth >= 0.45 / dt_s:
        return imu
    sections = butter(2, rig.imu.bandwidth, fs=1.0 / dt_s, output="sos")
    start = sosfilt_zi(sections)[:, :, None] * imu[0][None, None, :]
    out, _ = sosfilt(sections, imu, axis=0, zi=start)
    return np.asarray(out)


def calibrated(series: Mapping[str, Series], sensors: Sensors) -> dict[str, Series]:
    """IMU signals with bias, scale and squareness of the rig file taken out; stamps stay."""
    bias = (*sensors.gyro_bias, *sensors.accel_bias)
    scale = (1.0, 1.0, 1.0, *sensors.accel_scale)
    out = {
        s: (series[s][0], (series[s][1] - bias[k]) / scale[k])
        for k, s in enumerate(IMU_SIGNALS)
        if s in series
    }
    x, y, z = IMU_SIGNALS[3:]
    cross = sensors.accel_cross
    if any(cross) and {x, y, z} <= set(out):

        def of(signal: str, at_s: Array) -> Array:
            return np.asarray(np.interp(at_s, *out[signal]))

        out[x] = (out[x][0], out[x][1] + cross[0] * of(y, out[x][0]) + cross[1] * of(z, out[x][0]))
        out[y] = (out[y][0], out[y][1] + cross[2] * of(z, out[y][0]))
    return out


def noise_of(signal: str, rig: BicycleFile) -> tuple[float, float]:
    """Standard deviation and quantisation step of a signal, as the rig file expects them."""
    name = signal if signal in SIGNALS else signal.partition(".")[2].partition("_")[0]
    return getattr(rig.noise, name), getattr(rig.noise, f"{name}_step")
