"""`python -m benchmarks.other_rides.check`: does this world keep the contract's conventions?

Compares rides without any scatter or noise with `hil`'s own multibody kinematics, which this world does
not use, and the marks that effects leave with the signs and sizes that the catalogue gives them.
"""

from __future__ import annotations

import sys
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from benchmarks.other_rides.balance import Hold
from benchmarks.other_rides.bicycle import (
    Bicycle,
    Outing,
    draw_bicycle,
    draw_outing,
    go,
    noise_free,
)
from benchmarks.other_rides.body import Body
from benchmarks.other_rides.case import draw, write
from benchmarks.other_rides.deck import Card
from benchmarks.other_rides.effects import make
from benchmarks.other_rides.kinematics import UP
from benchmarks.other_rides.plan import KINDS
from benchmarks.other_rides.ridden import FINE_S, PLAN_S, Truth
from benchmarks.other_rides.sensing import ALL, COORDINATES, IMU, Channel, Sensing, turned_back
from benchmarks.other_rides.travel import Springs
from hil.bicycle.sensors import misaligned
from hil.config import BicycleFile
from hil.configfile import find_rig_file, load_bicycle
from hil.rigs.bicycle import Motion, Packed, pack, smooth
from hil.rigs.bicycle import ride as theirs
from hil.runs.reader import load_run

Array = NDArray[np.float64]

PERFECT: Final = Body(
    springs=Springs(1e8, 1e4, 0.0),
    hold=Hold(1e7, 1e4),
    restless_rad=0.0,
    rear_scale=1.0,
    front_scale=1.0,
    crown_m=0.0,
    flex=0.0,
    side_slip=(0.0, 0.0),
    roughness_m3=1e-14,
)
EXACT: Final = Sensing({s: Channel() for s in ALL}, (0.0, 0.0, 0.0), 0.0)


def their_ride(
    rig: BicycleFile,
    truth: Truth,
    bicycle: Packed | None = None,
    **springs: tuple[float, float, float],
) -> Motion:
    """`hil`'s ride of the same coordinates, by the rig file's model or `bicycle`."""
    angles = np.column_stack([truth.lean, truth.wheel, truth.steer])
    told = smooth(angles - [0.0, angles[0, 1], 0.0], FINE_S, None)
    return theirs(bicycle or pack(rig), told, **springs)


def agreement(rig: BicycleFile, mine: Array, other: Array) -> float:
    """Rms of the difference over the sensor's noise, the worst of the IMU's axes; ends left out."""
    apart = (mine - other)[:, 1000:-300]
    return float((np.sqrt((apart**2).mean(axis=1)) / _noise(rig)).max())


def report(name: str, value: float, low: float, high: float) -> bool:
    """One line; whether the value lies within its bounds."""
    good = low <= value <= high
    print(f"{'ok  ' if good else 'FAIL'} {name}: {value:.4g} within [{low:.4g}, {high:.4g}]")
    return good


def ideal_rides(rig: BicycleFile) -> list[bool]:
    """A perfect bicycle is `hil`'s model, its IMU as well as its balance."""
    out = []
    for k, kind in enumerate(KINDS):
        outing = draw_outing(kind, np.random.default_rng(k), rig, PERFECT)
        truth = go(rig, PERFECT, outing).truth
        motion = their_ride(rig, truth)
        out.append(
            report(
                f"{kind}: IMU, over its noise", agreement(rig, truth.imu, motion.imu.T), 0.0, 0.05
            )
        )
        torque = motion.lean_torque[1000:-300]
        out.append(report(f"{kind}: lean torque, N m rms", float(torque.std()), 0.0, 0.1))
    return out


def physical_effects(rig: BicycleFile) -> list[bool]:
    """Compliances, wheel sizes and slip as `hil`'s model with the same parameters has them."""
    outing = draw_outing("mixed", np.random.default_rng(3), rig, PERFECT)
    steer = go(rig, PERFECT, outing).steer
    plain = go(rig, PERFECT, outing).truth
    lock = np.inf
    fork = replace(PERFECT.springs, fork=8e3, fork_damping=300.0)
    tyre = Springs(3e4, 300.0, 0.0)
    tries: list[tuple[str, Body, dict[str, object], float]] = [
        ("fork 8 kN/m", replace(PERFECT, springs=fork),
         {"spring": (8e3, lock, lock), "damper": (300.0, 0.0, 0.0)}, 0.1),
        ("tyres 30 kN/m", replace(PERFECT, springs=tyre),
         {"spring": (lock, 3e4, 3e4), "damper": (0.0, 300.0, 300.0)}, 0.1),
        ("rear wheel +4 %", replace(PERFECT, rear_scale=1.04),
         {"bicycle": pack(rig).scaled(rear=1.04)}, 0.05),
        ("front wheel -4 %", replace(PERFECT, front_scale=0.96),
         {"bicycle": pack(rig).scaled(front=0.96)}, 0.05),
    ]  # fmt: skip
    out = []
    for name, body, options, most in tries:
        truth = go(rig, body, outing, steer).truth
        theirs_, rigid = their_ride(rig, truth, **options).imu.T, their_ride(rig, truth).imu.T
        inside = slice(1000, -300)
        share = np.sqrt(
            ((truth.imu - theirs_)[:, inside] ** 2).mean(1)
            / ((truth.imu - rigid)[:, inside] ** 2).mean(1)
        )
        k = int(np.argmax(np.sqrt(((truth.imu - rigid)[:, inside] ** 2).mean(1)) / _noise(rig)))
        out.append(report(f"{name}: left of the gap in {IMU[k]}", float(share[k]), 0.0, most))
    slipped = go(rig, replace(PERFECT, slip=0.05), outing, steer).truth
    slope = float(np.polyfit(plain.imu[2], slipped.imu[2], 1)[0])
    out.append(report("slip 5 %: yaw rate over that without", slope, 0.92, 0.97))
    leant = go(rig, replace(PERFECT, hold=Hold(1000.0, 100.0, 0.5)), outing).steer
    slope = float(np.polyfit(steer, leant, 1)[0])
    out.append(report("counter-lean 0.5: steer over that without", slope, 0.8, 0.97))
    return out


def sensor_effects(rig: BicycleFile) -> list[bool]:
    """Bias, scale, delay, clock, step and misalignment of a perfect record."""
    outing = draw_outing("mixed", np.random.default_rng(4), rig, PERFECT)
    truth = go(rig, PERFECT, outing).truth
    perfect = Bicycle(PERFECT, EXACT)
    plain = noise_free(rig, truth, EXACT, outing)

    def with_fault(
        effect: str, place: str, size: float
    ) -> tuple[dict[str, Array], dict[str, float]]:
        fault = make(effect, place, np.random.default_rng(5))
        faulty = fault.on(perfect, size)
        told = fault.parameters(size, rig, faulty, [outing])
        return noise_free(rig, truth, faulty.sensing, outing), told

    out = []
    for s in ALL:
        if s != "rear_wheel":
            read, told = with_fault("sensor_bias", s, 0.05)
            error = float(np.abs(read[s] - plain[s] - told["offset"]).max())
            out.append(report(f"bias of {s}", error, 0.0, 1e-9))
    for s in COORDINATES:
        read, told = with_fault("sensor_scale", s, 0.1)
        error = float(np.abs(read[s] - told["scale"] * plain[s]).max())
        out.append(report(f"scale of {s}", error, 0.0, 1e-9))
    for place, s in (("steer", "steer"), ("imu", "imu.gyro_z")):
        read, _ = with_fault("sensor_latency", place, 0.05)
        earlier = np.interp(outing.luck.stamps[s] - 0.05, outing.luck.stamps[s], plain[s])
        inside = outing.luck.stamps[s] > 0.1
        error = float(np.abs(read[s] - earlier)[inside].max() / np.ptp(plain[s]))
        out.append(report(f"latency of {place}: shows what was 50 ms ago", error, 0.0, 0.02))
    read, told = with_fault("clock_drift", "imu", 0.003)
    stamps = outing.luck.stamps["imu.gyro_z"]
    fast = np.interp(stamps / (1.0 + told["rate"]), stamps, plain["imu.gyro_z"])
    error = float(np.abs(read["imu.gyro_z"] - fast).max() / np.ptp(fast))
    out.append(report("clock: what happens at t is stamped t (1 + rate)", error, 0.0, 0.02))
    read, _ = with_fault("sensor_quantisation", "lean", 0.02)
    out.append(
        report("step of lean", float(np.abs(read["lean"] % 0.02 - 0.01).min()), 0.0099, 0.0101)
    )
    angles = (0.1, -0.2, 0.3)
    names = {f"imu.sensor_misalignment.{c}": a for c, a in zip("xyz", angles, strict=True)}
    mine = np.vstack([turned_back(angles, v) for v in (truth.imu[:3], truth.imu[3:])])
    error = float(np.abs(misaligned(truth.imu.T, names).T - mine).max())
    out.append(report("misalignment is that of hil.bicycle.sensors", error, 0.0, 1e-9))
    rolled = float(turned_back((0.1, 0.0, 0.0), 9.81 * UP)[1, 0])
    out.append(report("IMU rolled to the right by 0.1 rad feels +y", rolled, 0.97, 0.99))
    return out


def healthy_records(rig: BicycleFile) -> list[bool]:
    """With all scatter, an IMU is what the rig file's model makes of the coordinates, but for little."""
    out = []
    for seed in range(5):
        rng = np.random.default_rng(seed)
        bicycle = draw_bicycle(rng)
        outing: Outing = draw_outing("mixed", rng, rig, bicycle.body)
        truth = go(rig, bicycle.body, outing).truth
        model = their_ride(rig, truth).imu.T
        kernel = np.ones(100) / 100.0  # 0.2 s: what a diagnosis in the band of riding sees
        for k in (0, 2, 3):
            read = noise_free(rig, truth, bicycle.sensing, outing)[IMU[k]]
            stamps = outing.luck.stamps[IMU[k]]
            apart = read - np.interp(stamps, truth.t_s, model[k])
            apart = np.convolve(apart, kernel, "valid")
            over = float(np.sqrt((apart**2).mean()) / _noise(rig)[k])
            out.append(report(f"healthy {seed}: {IMU[k]} missed, over its noise", over, 0.0, 1.6))
    return out


def readable(rig: BicycleFile) -> list[bool]:
    """A written case is read by `hil.runs`, twice the same bytes."""
    path, out = find_rig_file("bicycle"), []
    with tempfile.TemporaryDirectory() as folder:
        written = []
        for name in ("a", "b"):
            place = Path(folder) / name
            case = draw(rig, 99, 0, Card((("sensor_bias", "steer"),), None, 3, True))
            write(case, rig, path, place)
            files = sorted(p for p in place.rglob("*") if p.is_file())
            written.append([(p.relative_to(place), p.read_bytes()) for p in files])
        out.append(report("same bytes", float(written[0] == written[1]), 1.0, 1.0))
        for run in sorted((Path(folder) / "a" / "cases").glob("*/run*")):
            read = load_run(run, rig)
            rates = read.table["steer"].notna().sum() / read.duration_s
            out.append(report(f"{run.name}: samples of steer a second", float(rates), 99.0, 101.0))
    return out


def _noise(rig: BicycleFile) -> Array:
    return np.repeat([rig.noise.gyro, rig.noise.accel], 3)


def main() -> None:
    """All checks; exit status 1 where one fails."""
    rig = load_bicycle("bicycle")
    print(f"plans every {1e3 * PLAN_S:.0f} ms, motion every {1e3 * FINE_S:.0f} ms")
    checks = (ideal_rides, physical_effects, sensor_effects, healthy_records, readable)
    results = [good for check in checks for good in check(rig)]
    sys.exit(not all(results))


if __name__ == "__main__":
    main()
