"""What the exam's sensors make of a ride: other noise than the simulated bicycle's, and what is wrong with
them.

An inclinometer with a lag and coloured noise; encoders that count edges, from anywhere within a step; an
IMU whose filter is two poles apart, whose scales are never one and that feels the wheels' imbalance.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.signal import lfilter

from hil.bicycle.sensors import IMU_SIGNALS, noise_of
from hil.config.bicycle import SIGNALS
from hil.exam.rides.world import STEP_S, Bicycle, Ridden
from hil.rigs.bicycle.parameters import rotation
from hil.runs.table import TableBuilder, signal_order

Array = NDArray[np.float64]
Rng = np.random.Generator

COLOUR_S: Final = 0.02
GRAVITY: Final = 9.81


@dataclass(frozen=True, slots=True)
class Off:
    """What a healthy bicycle's sensors are off by: zeros within a rad's thousandths, scales 2 ‰, a ms."""

    zero: Array
    scale: Array
    late_s: Array
    imu_bias: Array
    imu_scale: Array
    imu_late_s: float
    noise: Array

    @classmethod
    def of(cls, b: Bicycle) -> Off:
        """Drawn from the bicycle's scatter."""
        rng = np.random.default_rng([b.scatter.seed, 83])

        def off(spread: float, *shape: int) -> Array:
            return np.asarray(b.scatter.size * spread * rng.uniform(-1.0, 1.0, shape))

        bias = 0.5 * np.repeat([b.rig.noise.gyro, b.rig.noise.accel], 3) * off(1.0, 6)
        return cls(
            np.array([float(off(0.003)), 0.0, float(off(0.0022))]), 1.0 + off(0.002, 3),
            np.abs(off(0.0015, 3)), bias, 1.0 + off(0.003, 6), float(off(0.0015)),
            1.0 + off(0.15, 5),
        )  # fmt: skip


def record(b: Bicycle, ridden: Ridden, seed: int | None) -> pd.DataFrame:
    """The run's table; `seed` None: without noise, rounding and jitter, all else the same."""
    rng = None if seed is None else np.random.default_rng([seed, 84])
    off = Off.of(b)
    builder = TableBuilder()
    angles = _angles(b, ridden)
    end = float(ridden.t_s[-1])
    t = _stamps(rng, b.rig.rate, end, b.rig.bus.jitter)
    for k, signal in enumerate(SIGNALS):
        seen = _answer(
            b, signal, ridden.t_s, angles[:, k], t, off.scale[k], off.zero[k], off.late_s[k]
        )
        sigma, step = noise_of(signal, b.rig)
        seen = _spoilt(rng, seen, sigma * off.noise[k], step, 1.0 / b.rig.rate)
        if signal == "lean":
            seen = np.clip(seen, -b.rig.sensors.lean_range, b.rig.sensors.lean_range)
        for at, value in zip(t.tolist(), seen.tolist(), strict=True):
            builder.add(signal, round(at, 6), value)
    if b.rig.imu is not None:
        _add_imu(builder, b, ridden, off, rng, end)
    return builder.table(b.rig.name, signal_order(b.rig))


def _angles(b: Bicycle, ridden: Ridden) -> Array:
    """(N, 3) what lean, wheel and steer really are where they are measured, outside effects in them."""
    q, qd = ridden.q, ridden.qd
    rolled = q[:, 4] - (q[:, 5] if b.rig.sensors.encoder_on_frame else 0.0)
    out = np.column_stack([q[:, 3], rolled - rolled[0], q[:, 6]])
    speed = qd[:, 0] * np.cos(q[:, 2]) + qd[:, 1] * np.sin(q[:, 2])
    across = speed * qd[:, 2]
    if slip := b.size("side_slip"):
        out[:, 2] += slip["compliance"] * across
    if play := b.size("loose_headset"):
        out[:, 2] = _played(out[:, 2], play["play"])
    if felt := b.size("felt_turns"):
        out[:, 0] += felt["share"] * (across / GRAVITY + np.sin(q[:, 3]))
    if missed := b.size("missed_counts"):
        rate = np.gradient(out[:, 1], STEP_S)
        lost = missed["share"] * np.clip(rate - missed["above"], 0.0, None)
        out[:, 1] -= np.cumsum(lost) * STEP_S
    return out


def _played(steer: Array, play: float) -> Array:
    """The encoder follows the fork through a gap."""
    out, at = np.empty_like(steer), float(steer[0])
    for k, x in enumerate(steer.tolist()):
        at = min(max(at, x - 0.5 * play), x + 0.5 * play)
        out[k] = at
    return out


def _answer(
    b: Bicycle, signal: str, t: Array, truth: Array, at: Array, scale: float, zero: float, late_s: float
) -> Array:  # fmt: skip
    """What a sensor answers at `at`, its effects in it; half of a latency is a lag."""
    delay = b.values("sensor_latency", signal).get("delay", 0.0)
    if delay > 0.0:
        keep = float(np.exp(-STEP_S / (0.5 * delay)))
        truth = lfilter([1.0 - keep], [1.0, -keep], truth, zi=[keep * truth[0]])[0]
    seen = np.interp(at - 0.5 * delay - late_s, t, truth)
    scale *= b.values("sensor_scale", signal).get("scale", 1.0)
    return np.asarray(scale * seen + zero + b.values("sensor_bias", signal).get("offset", 0.0))


def _spoilt(rng: Rng | None, seen: Array, sigma: float, step: float, dt_s: float) -> Array:
    if rng is None:
        return seen
    keep = float(np.exp(-dt_s / COLOUR_S))
    white = rng.standard_normal(len(seen))
    own = lfilter([np.sqrt(1.0 - keep**2)], [1.0, -keep], white)
    seen = seen + sigma * (0.8 * white + 0.6 * own)
    if step > 0.0:
        phase = rng.uniform(0.0, step)
        seen = step * np.floor((seen + phase) / step) + 0.5 * step - phase
    return np.asarray(seen)


def _add_imu(
    builder: TableBuilder, b: Bicycle, ridden: Ridden, off: Off, rng: Rng | None, end: float
) -> None:
    imu = b.rig.imu
    assert imu is not None
    seen = _felt(b, ridden)
    pole = float(np.exp(-2.0 * np.pi * 1.55 * imu.bandwidth * STEP_S))
    for _ in range(2):
        seen = lfilter([1.0 - pole], [1.0, -pole], seen, axis=0, zi=pole * seen[:1])[0]
    filter_s = 2.0 / (2.0 * np.pi * 1.55 * imu.bandwidth)
    t = _stamps(rng, imu.rate, end - 0.05, 5e-5)
    shown = t * (1.0 + b.values("clock_drift", "imu").get("rate", 0.0))
    late = b.values("sensor_latency", "imu").get("delay", 0.0) + off.imu_late_s + imu.delay
    for k, signal in enumerate(IMU_SIGNALS):
        answers = _answer(
            b, signal, ridden.t_s - filter_s, seen[:, k], t - late, float(off.imu_scale[k]),
            float(off.imu_bias[k]), 0.0,
        )  # fmt: skip
        sigma, step = noise_of(signal, b.rig)
        answers = _spoilt(rng, answers, sigma * off.noise[3 if k < 3 else 4], step, 1.0 / imu.rate)
        for at, value in zip(shown.tolist(), answers.tolist(), strict=True):
            builder.add(signal, round(at, 6), value)


def _felt(b: Bicycle, ridden: Ridden) -> Array:
    """(N, 6) what the IMU feels: imbalance of the wheels, and what no catalogue names."""
    out = ridden.imu.copy()
    turned = ridden.q[:, 4]
    rate = ridden.qd[:, 4]
    out[:, 5] += 0.0001 * rate**2 * np.sin(turned)  # a valve, and a rim that is not true
    out[:, 3] += 0.0001 * rate**2 * np.cos(turned)
    if hills := b.size("hills"):
        slope, pitch = _hills(ridden, hills)
        out[:, 3] += GRAVITY * slope
        out[:, 1] -= pitch
    if bracket := b.size("soft_bracket"):
        out = _bent(out, bracket)
    if warm := b.size("warm_gyro"):
        out[:, int(warm["axis"])] += warm["drift"] * ridden.t_s / ridden.t_s[-1]
    if gain := b.size("g_sensitive_gyro"):
        out[:, int(gain["axis"])] += gain["gain"] * out[:, 3]
    turn = b.values("sensor_misalignment", "imu")
    if turn:
        R = rotation(*(turn.get(c, 0.0) for c in "xyz"))
        out = np.hstack([out[:, :3] @ R, out[:, 3:] @ R])
    return out


def _hills(ridden: Ridden, hills: Mapping[str, float]) -> tuple[Array, Array]:
    """(N,) slope of the road and the rate at which it pitches the bicycle."""
    way = np.hypot(ridden.qd[:, 0], ridden.qd[:, 1])
    ridden_m = np.cumsum(way) * STEP_S
    slope = hills["slope"] * np.sin(2.0 * np.pi * ridden_m / hills["length"])
    return slope, np.gradient(slope, STEP_S)


def _bent(imu: Array, bracket: Mapping[str, float]) -> Array:
    """The sensor nods on a spring: a resonance between forward acceleration and its own pitch."""
    w, z = 2.0 * np.pi * bracket["hz"], bracket["damping"]
    load = -bracket["compliance"] * imu[:, 3]
    k = 2.0 / STEP_S
    b = w * w * np.array([1.0, 2.0, 1.0])
    a = np.array(
        [
            k * k + 2.0 * z * w * k + w * w,
            2.0 * w * w - 2.0 * k * k,
            k * k - 2.0 * z * w * k + w * w,
        ]
    )
    nod = lfilter(b / a[0], a / a[0], load)
    out = imu.copy()
    out[:, 1] += np.gradient(nod, STEP_S)
    out[:, 3] -= nod * imu[:, 5]
    return out


def _stamps(rng: Rng | None, rate_hz: float, end_s: float, jitter_s: float) -> Array:
    t = np.arange(0.0, end_s, 1.0 / rate_hz)
    if rng is not None:
        late = jitter_s * np.minimum(
            rng.exponential(1.0, len(t)), 4.0
        )  # frames wait, none is early
        t = t + np.minimum(late, 0.4 / rate_hz)
    return np.asarray(t)
