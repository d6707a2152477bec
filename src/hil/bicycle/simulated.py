"""A simulated ride as its sensors record it: noise, quantisation, saturation, jitter, and effects."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path as FilePath

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.integrate import cumulative_trapezoid

from hil.bicycle.creep import turns
from hil.bicycle.effects import CREEP, RideEffects
from hil.bicycle.path import Path, u_turns
from hil.bicycle.sensors import IMU_SIGNALS, Sensor, misaligned, noise_of, through_filter
from hil.bicycle.world import STEP_S, RideTruth, ride_along
from hil.config import BicycleFile
from hil.config.bicycle import SIGNALS
from hil.configfile import rig_toml
from hil.errors import RunError
from hil.files import whole_folder
from hil.runs.folder import RIG_TOML, RunMeta, write_meta
from hil.runs.table import TableBuilder, signal_order

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class SimulatedRide:
    """What was recorded, as a run's table, and what really happened."""

    rig: BicycleFile
    table: pd.DataFrame
    truth: RideTruth


def simulate_ride(
    rig: BicycleFile,
    path: Path | None = None,
    seed: int = 0,
    *,
    cruise: float = 5.0,
    turning: float = 3.6,
    road_m: float = 0.0,
    restless: float = 0.004,
    vigour: float = 1.0,
) -> SimulatedRide:
    """Ride `rig` with its file's effects along `path` (default: out, U-turn, back, U-turn) and record it."""
    truth = ride_along(
        rig,
        path or u_turns(),
        seed,
        cruise=cruise,
        turning=turning,
        road_m=road_m,
        restless=restless,
        vigour=vigour,
    )
    return SimulatedRide(rig, record(rig, truth, seed), truth)


def record(rig: BicycleFile, truth: RideTruth, seed: int = 0) -> pd.DataFrame:
    """The table that the bicycle's sensors make of what happened."""
    rng = np.random.default_rng([seed, 1])
    values = RideEffects.of(rig).values
    q, end = truth.q, truth.t_s[-1]
    turned = q[:, 4]
    if creeps := values[CREEP]:
        rate = np.gradient(turned, STEP_S)
        drive = truth.torques[:, 1] / (rig.geometry.R * sum(rig.mass.m))
        more = turns(rate, drive, creeps) - rate
        turned = turned + cumulative_trapezoid(more, dx=STEP_S, initial=0.0)
    rolled = turned - (q[:, 5] if rig.sensors.encoder_on_frame else 0.0)
    builder = TableBuilder()
    stamps = _stamps(rng, rig.rate, end, rig.bus.jitter)
    for signal, angle in zip(SIGNALS, (q[:, 3], rolled - rolled[0], q[:, 6]), strict=True):
        sensor = Sensor.of(signal, values)
        if signal == "lean":
            sensor = Sensor(sensor.offset + rig.sensors.lean_zero, sensor.scale,
                            sensor.delay_s + rig.sensors.lean_delay, sensor.step)  # fmt: skip
        elif signal == "steer":
            sensor = Sensor(
                sensor.offset + rig.sensors.steer_zero, sensor.scale, sensor.delay_s, sensor.step
            )
        seen = _measured(sensor, truth.t_s, angle, stamps, noise_of(signal, rig), rng)
        if signal == "lean":
            seen = np.clip(seen, -rig.sensors.lean_range, rig.sensors.lean_range)
        for t, value in zip(stamps, seen, strict=True):
            builder.add(signal, float(t), float(value))
    if rig.imu is not None:
        _record_imu(builder, rig, truth, values, rng)
    return builder.table(rig.name, signal_order(rig))


def save(ride: SimulatedRide, folder: FilePath, note: str = "") -> FilePath:
    """Write the ride as a run folder; its rig file keeps no effects: nobody told the recorder of them."""
    try:
        with whole_folder(folder) as fresh:
            ride.table.to_parquet(fresh / "signals.parquet", index=False, compression="zstd")
            plain = ride.rig.model_copy(update={"effects": ()})
            (fresh / RIG_TOML).write_text(rig_toml(plain), encoding="utf-8")
            write_meta(fresh, RunMeta(rig=ride.rig.name, mode="ride", note=note))
    except FileExistsError as error:
        raise RunError(f"{folder}: exists already; a ride never overwrites") from error
    except OSError as error:
        raise RunError(f"{folder}: cannot be written: {error.strerror}") from error
    return folder


def _record_imu(
    builder: TableBuilder,
    rig: BicycleFile,
    truth: RideTruth,
    values: Mapping[str, float],
    rng: np.random.Generator,
) -> None:
    assert rig.imu is not None
    seen = through_filter(misaligned(truth.imu, values), rig, STEP_S)
    stamps = _stamps(rng, rig.imu.rate, truth.t_s[-1] - rig.imu.group_delay_s, 0.0)
    bias = (*rig.sensors.gyro_bias, *rig.sensors.accel_bias)
    scale = (1.0, 1.0, 1.0, *rig.sensors.accel_scale)
    shown = stamps * (1.0 + values["imu.clock_drift.rate"])
    for k, signal in enumerate(IMU_SIGNALS):
        sensor = Sensor.of(signal, values)
        sensor = Sensor(
            sensor.offset + bias[k],
            sensor.scale * scale[k],
            sensor.delay_s + rig.imu.delay,
            sensor.step,
        )
        # stamps are those of the truth: the filter's group delay is taken out, as everywhere
        answers = _measured(
            sensor,
            truth.t_s - rig.imu.group_delay_s,
            seen[:, k],
            stamps,
            noise_of(signal, rig),
            rng,
        )
        for t, value in zip(shown, answers, strict=True):
            builder.add(signal, float(t), float(value))


def _measured(
    sensor: Sensor, t_s: Array, truth: Array, at_s: Array, noise: tuple[float, float],
    rng: np.random.Generator,
) -> Array:  # fmt: skip
    sigma, step = noise
    plain = Sensor(sensor.offset, sensor.scale, sensor.delay_s)
    out = plain.answer(t_s, truth, at_s) + sigma * rng.standard_normal(len(at_s))
    for size in (step, sensor.step):
        if size > 0.0:
            out = np.round(out / size) * size
    return out


def _stamps(rng: np.random.Generator, rate_hz: float, end_s: float, jitter_s: float) -> Array:
    """Sample instants from 0 to the end; jittered ones stay in order."""
    t = np.arange(0.0, end_s, 1.0 / rate_hz)
    if jitter_s > 0.0:
        t = t + np.clip(jitter_s * rng.standard_normal(len(t)), -0.4 / rate_hz, 0.4 / rate_hz)
        t -= min(float(t[0]), 0.0)
    return t
