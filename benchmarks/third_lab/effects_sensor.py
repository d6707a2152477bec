"""Catalogue: sensors and clocks. The loops never see these: they spoil what is recorded, not what is done."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from benchmarks.third_lab.effect import Effect, Setting, on_sensing
from benchmarks.third_lab.sensing import IMU, sigma, signals

_BIAS = {
    "position": (5e-5, 0.02),
    "force": (8.0, 200.0),
    "gyro": (0.006, 0.1),
    "accel": (0.08, 1.0),
}
_SCALE = {
    "position": (0.001, 0.1),
    "force": (0.025, 0.4),
    "gyro": (0.015, 0.4),
    "accel": (0.015, 0.4),
}


def sensor_bias(s: Setting) -> Effect:
    """Reported = true + offset."""
    signal, side = _signal(s), s.side()
    return Effect(
        "sensor_bias",
        signal,
        *_BIAS[_quantity(signal)],
        on_sensing(lambda x, m: m.plus("bias", **{signal: side * x})),
        lambda x: {"offset": side * x},
        calibrates_away=True,
    )


def sensor_scale(s: Setting) -> Effect:
    """Reported = scale times true, positions about home."""
    signal, side = _signal(s), s.side()
    return Effect(
        "sensor_scale",
        signal,
        *_SCALE[_quantity(signal)],
        on_sensing(lambda x, m: m.times(signal, 1.0 + side * x)),
        lambda x: {"scale": 1.0 + side * x},
        calibrates_away=True,
    )


def sensor_latency(s: Setting) -> Effect:
    """Values are older than their stamps say; of the IMU all six alike."""
    signal = _signal(s)
    touched = [signal]
    if signal in IMU:
        signal, touched = "imu", list(IMU)
    return Effect(
        "sensor_latency",
        signal,
        1.5e-3,
        0.03,
        on_sensing(lambda x, m: m.plus("delay", **dict.fromkeys(touched, x))),
        lambda x: {"delay": x},
        calibrates_away=True,
    )


def sensor_misalignment(s: Setting) -> Effect:
    """The IMU is turned in its mount by the rotation vector x y z."""
    d = s.direction()
    return Effect(
        "sensor_misalignment",
        "imu",
        0.006,
        0.2,
        on_sensing(lambda x, m: replace(m, turn=m.turn + x * d)),
        lambda x: dict(zip("xyz", map(float, x * d), strict=True)),
        calibrates_away=True,
    )


def sensor_quantisation(s: Setting) -> Effect:
    """A coarser step."""
    signal = _signal(s)
    noise = sigma(s.ideal, signal)[0]
    return Effect(
        "sensor_quantisation",
        signal,
        3.0 * noise,
        80.0 * noise,
        on_sensing(lambda x, m: replace(m, step={**m.step, signal: x})),
        lambda x: {"step": x},
    )


def clock_drift(s: Setting) -> Effect:
    """The group's stamps run fast (positive) or slow."""
    group, side = str(s.rng.choice(["imu", "drives"])), s.side()
    return Effect(
        "clock_drift",
        group,
        6e-5,
        3e-3,
        on_sensing(lambda x, m: m.plus("clock", **{group: side * x})),
        lambda x: {"rate": side * x},
    )


def _signal(s: Setting) -> str:
    """Of a drive or of the IMU, half and half."""
    names = signals(s.ideal)
    drives = [n for n in names if n not in IMU]
    inertial = [n for n in names if n in IMU]
    return str(s.rng.choice(np.array(drives if s.rng.random() < 0.5 or not inertial else inertial)))


def _quantity(signal: str) -> str:
    return signal.split(".")[1].split("_")[0]


MAKERS = (
    sensor_bias,
    sensor_scale,
    sensor_latency,
    sensor_misalignment,
    sensor_quantisation,
    clock_drift,
)
