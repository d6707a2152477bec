"""What sensors make of a trace: instants, lags, scales, offsets, noise, steps, and faults of reading."""

from __future__ import annotations

import zlib
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from math import pi, sqrt

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.third_lab.plant import Plant
from benchmarks.third_lab.world import Trace

IMU = tuple(f"imu.{kind}_{axis}" for kind in ("gyro", "accel") for axis in "xyz")


@dataclass(frozen=True)
class Sensing:
    """Departures of the sensors from the rig file, by signal; what is missing is nominal."""

    answer_delay: np.ndarray  # (n,) s, sample instant to answer
    bias: Mapping[str, float] = field(default_factory=dict)
    scale: Mapping[str, float] = field(default_factory=dict)
    delay: Mapping[str, float] = field(default_factory=dict)
    step: Mapping[str, float] = field(default_factory=dict)
    turn: np.ndarray = field(default_factory=lambda: np.zeros(3))  # rotation vector of the IMU, rad
    clock: Mapping[str, float] = field(default_factory=dict)  # of "imu", "drives": s/s, stamps fast
    lost_answers: float = 0.0
    stale: float = 0.0  # fault: share of answers that repeat the one before
    warm_bias: Mapping[str, float] = field(default_factory=dict)  # fault: bias that comes with time
    warm_tau: float = 10.0

    def plus(self, kind: str, **by_signal: float) -> Sensing:
        """With the mapping `kind` raised by `by_signal` (names with dots as dict)."""
        old: Mapping[str, float] = getattr(self, kind)
        return replace(
            self, **{kind: {**old, **{s: old.get(s, 0.0) + v for s, v in by_signal.items()}}}
        )

    def times(self, signal: str, factor: float) -> Sensing:
        """With the scale of `signal` multiplied."""
        return replace(self, scale={**self.scale, signal: self.scale.get(signal, 1.0) * factor})


def signals(plant: Plant) -> list[str]:
    """Every measured signal of the rig."""
    names = [
        f"{a}.{q}" for a in plant.rig.actuator_names for q in dict.fromkeys(plant.rig.bus.pattern)
    ]
    return names + (list(IMU) if plant.rig.imu else [])


def sigma(plant: Plant, signal: str) -> tuple[float, float]:
    """Noise (standard deviation) and step of `signal` by the rig file."""
    quantity = signal.split(".")[1].split("_")[0]
    noise = plant.rig.noise
    return getattr(noise, quantity), getattr(noise, f"{quantity}_step")


def instants(plant: Plant, sensing: Sensing, signal: str, stamps: np.ndarray) -> np.ndarray:
    """When the values stamped `stamps` were sampled, answers without jitter."""
    group = "imu" if signal.startswith("imu.") else "drives"
    true = stamps / (1.0 + sensing.clock.get(group, 0.0))
    return (
        true if group == "imu" else true - sensing.answer_delay[plant.index(signal.split(".")[0])]
    )


def reading(
    plant: Plant, sensing: Sensing, trace: Trace, signal: str, sampled: np.ndarray, seed: int
) -> np.ndarray:
    """Values of `signal` sampled at `sampled` (s), noise and all; the same seed makes the same noise."""
    rng = np.random.default_rng([seed, zlib.crc32(signal.encode())])
    at = sampled - sensing.delay.get(signal, 0.0)
    name, quantity = signal.split(".")
    middle = 0.0
    if name == "imu":
        values = _imu(plant, sensing, trace, at)[IMU.index(signal)]
    else:
        i = plant.index(name)
        tick = np.clip(np.floor(at / trace.dt + 1e-6).astype(int), 0, trace.position.shape[1] - 1)
        values = (trace.position if quantity == "position" else trace.force)[i, tick]
        if quantity == "position":
            middle = plant.rig.actuators[i].home
    values = (
        middle + sensing.scale.get(signal, 1.0) * (values - middle) + sensing.bias.get(signal, 0.0)
    )
    values = values + sensing.warm_bias.get(signal, 0.0) * (
        1.0 - np.exp(-np.maximum(at, 0.0) / sensing.warm_tau)
    )
    noise, step = sigma(plant, signal)
    values = values + noise * rng.standard_normal(len(at))
    repeat = rng.random(len(at)) < sensing.stale
    for size in (step, sensing.step.get(signal, 0.0)):
        if size > 0.0:
            values = np.round(values / size) * size
    if name != "imu" and repeat.any():
        last = np.maximum.accumulate(np.where(repeat, 0, np.arange(len(at))))
        values = values[last]
    return values


def _imu(plant: Plant, sensing: Sensing, trace: Trace, at: np.ndarray) -> np.ndarray:
    """The six at `at` with the filter's group delay taken out, in the sensor's frame."""
    imu = plant.rig.imu
    late = sqrt(2.0) / (2.0 * pi * imu.bandwidth) - imu.delay
    ticks = np.arange(trace.imu.shape[1]) * trace.dt
    six = np.stack([np.interp(at + late, ticks, row) for row in trace.imu])
    mounted = Rotation.from_euler("ZYX", imu.orientation[::-1])
    back = (mounted * Rotation.from_rotvec(sensing.turn)).inv().as_matrix()
    return np.concatenate([back @ six[:3], back @ six[3:]])
