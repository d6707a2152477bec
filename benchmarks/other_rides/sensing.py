"""What the sensors make of the truth, and the table that a recorder would have kept of it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Final

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.signal import butter, sosfilt, sosfilt_zi

from benchmarks.other_rides.frames import turn_x, turn_y, turn_z
from benchmarks.other_rides.ridden import FINE_S, Truth
from hil.config import BicycleFile

Array = NDArray[np.float64]
Signals = dict[str, Array]

COORDINATES: Final = ("lean", "rear_wheel", "steer")
GYRO: Final = ("imu.gyro_x", "imu.gyro_y", "imu.gyro_z")
ACCEL: Final = ("imu.accel_x", "imu.accel_y", "imu.accel_z")
IMU: Final = GYRO + ACCEL
ALL: Final = COORDINATES + IMU
SLOT_S: Final = 0.0004
"""Between the frames of lean, wheel and steer on the bus."""


@dataclass(frozen=True, slots=True)
class Channel:
    """answer(t) = scale x truth(t - delay) + offset, rounded to `step` where it is not 0."""

    offset: float = 0.0
    scale: float = 1.0
    delay_s: float = 0.0
    step: float = 0.0


@dataclass(frozen=True, slots=True)
class Sensing:
    """All sensors of one bicycle."""

    channels: Mapping[str, Channel]
    mount: tuple[float, float, float]
    """Roll, pitch, yaw of the IMU against where the rig file has it, rad."""
    clock: float
    """Rate of the IMU's stamps, s/s: positive when they run fast."""
    misaligned: tuple[float, float, float] = (0.0, 0.0, 0.0)
    before: Callable[[Truth, Signals], Signals] | None = None
    """A fault that acts before sampling: takes signals at the truth's instants."""
    after: Callable[[Signals], Signals] | None = None
    """A fault that acts on samples."""


@dataclass(frozen=True, slots=True)
class Chance:
    """Stamps (s) and noise of unit rms of every signal of one ride."""

    stamps: Signals = field(default_factory=dict)
    noise: Signals = field(default_factory=dict)


def fitted(rng: np.random.Generator) -> Sensing:
    """Sensors in order, as the usual calibration leaves them."""
    spread = {"lean": 8e-4, "rear_wheel": 0.0, "steer": 6e-4}
    spread |= dict.fromkeys(GYRO, 8e-4) | dict.fromkeys(ACCEL, 0.015)
    gain = dict.fromkeys(("lean", "steer"), 0.002) | dict.fromkeys(IMU, 0.001) | {"rear_wheel": 0.0}
    late = {s: float(rng.uniform(0.0, 6e-4)) for s in COORDINATES}
    late |= dict.fromkeys(IMU, float(rng.uniform(-4e-4, 4e-4)))
    channels = {
        s: Channel(_drawn(rng, spread[s]), 1.0 + _drawn(rng, gain[s]), late[s]) for s in ALL
    }
    mount = tuple(_drawn(rng, 7e-4) for _ in range(3))
    return Sensing(channels, mount, float(rng.uniform(-2e-5, 2e-5)))


def chance(rng: np.random.Generator, rig: BicycleFile, duration_s: float) -> Chance:
    """Jittered stamps and noise of one ride."""
    assert rig.imu is not None
    out = Chance()
    imu = _stamps(rng, duration_s, rig.imu.rate, rig.bus.jitter, float(rng.uniform(0.0, 0.004)))
    for k, s in enumerate(ALL):
        own = k < len(COORDINATES)
        out.stamps[s] = (
            _stamps(rng, duration_s, rig.rate, rig.bus.jitter, k * SLOT_S) if own else imu
        )
        out.noise[s] = rng.standard_normal(len(out.stamps[s]))
    return out


def sense(
    rig: BicycleFile, truth: Truth, sensing: Sensing, luck: Chance, noise: Mapping[str, float]
) -> Signals:
    """Answers at the stamps with noise of these sizes; only steps of faults are rounded to."""
    felt = _mounted(rig, truth.imu, sensing)
    at = dict(zip(ALL, (truth.lean, truth.wheel, truth.steer, *felt), strict=True))
    if sensing.before is not None:
        at = sensing.before(truth, at)
    filtered = _filtered(rig, np.stack([at[s] for s in IMU]))
    at |= dict(zip(IMU, filtered, strict=True))
    delay = 0.0 if rig.imu is None else rig.imu.group_delay_s  # which the stamps leave out
    out = {}
    for s, channel in sensing.channels.items():
        when = luck.stamps[s] - channel.delay_s
        if s in IMU:
            when = luck.stamps[s] / (1.0 + sensing.clock) - channel.delay_s + delay
        values = np.interp(when, truth.t_s, at[s])
        if s == "rear_wheel":
            values = values - np.interp(luck.stamps[s][0] - channel.delay_s, truth.t_s, at[s])
        values = channel.scale * values + channel.offset + noise[s] * luck.noise[s]
        out[s] = np.round(values / channel.step) * channel.step if channel.step else values
    return out if sensing.after is None else sensing.after(out)


def recorded(rig: BicycleFile, answers: Signals, luck: Chance) -> pd.DataFrame:
    """The table: quantised answers in the rows of their stamps."""
    stamps = {s: np.round(luck.stamps[s], 6) for s in ALL}
    rows = np.unique(np.concatenate(list(stamps.values())))
    table = {"t": rows}
    for s in ALL:
        table[s] = np.full(len(rows), np.nan)
        step = sizes(rig)[s][1]
        table[s][np.searchsorted(rows, stamps[s])] = np.round(answers[s] / step) * step
    return pd.DataFrame(table)


def sizes(rig: BicycleFile) -> dict[str, tuple[float, float]]:
    """Noise and quantisation step of every signal, as the rig file has them."""
    n = rig.noise
    out = {
        "lean": (n.lean, n.lean_step),
        "rear_wheel": (n.rear_wheel, n.rear_wheel_step),
        "steer": (n.steer, n.steer_step),
    }
    out |= dict.fromkeys(GYRO, (n.gyro, n.gyro_step))
    return out | dict.fromkeys(ACCEL, (n.accel, n.accel_step))


def turned_back(angles: tuple[float, float, float], v: Array) -> Array:
    """Vectors (3, N) in the axes of a sensor that is turned by roll, then pitch, then yaw."""
    roll, pitch, yaw = angles
    return turn_x(-roll, turn_y(-pitch, turn_z(-yaw, v)))


def _mounted(rig: BicycleFile, imu: Array, sensing: Sensing) -> Array:
    assert rig.imu is not None
    out = []
    for v in (imu[:3], imu[3:]):
        for angles in (rig.imu.orientation, sensing.mount, sensing.misaligned):
            v = turned_back(angles, v)
        out.append(v)
    return np.vstack(out)


def _filtered(rig: BicycleFile, imu: Array) -> Array:
    """Through the IMU's own low-pass."""
    assert rig.imu is not None
    sections = butter(2, rig.imu.bandwidth, fs=1.0 / FINE_S, output="sos")
    rest = sosfilt_zi(sections)[:, None, :] * imu[None, :, :1]
    return np.asarray(sosfilt(sections, imu, axis=1, zi=rest)[0])


def _stamps(
    rng: np.random.Generator, duration_s: float, rate_hz: float, jitter_s: float, first_s: float
) -> Array:
    even = 0.002 + first_s + np.arange(int((duration_s - 0.01) * rate_hz)) / rate_hz
    shift = np.clip(jitter_s * rng.standard_normal(len(even)), -5.0 * jitter_s, 5.0 * jitter_s)
    return np.asarray(np.maximum.accumulate(np.maximum(even + shift, 0.0)))


def _drawn(rng: np.random.Generator, spread: float) -> float:
    """Normal, but never more than twice its spread."""
    return float(np.clip(spread * rng.standard_normal(), -2.0 * spread, 2.0 * spread))
