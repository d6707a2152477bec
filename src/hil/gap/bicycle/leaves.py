"""The candidates of a ride, and the nuisances that a calibration would set right first."""

from __future__ import annotations

from collections.abc import Collection
from typing import Final

import numpy as np

from hil.config import BicycleFile
from hil.config.bicycle import SIGNALS
from hil.gap.bicycle.twin import LEAN_TORQUE
from hil.gap.catalogue.nuisances import SWITCHED_ON, Nuisance
from hil.gap.record.leaf import Changes, Leaf, Start
from hil.gap.record.problem import Problem
from hil.units import quantity_unit

LEAN_ZERO: Final = 0.004
"""rad: how upright a bicycle is held when its inclinometer is zeroed [R]."""
STEER_ZERO: Final = 0.0026
"""rad: one step of the encoder."""
RADIUS: Final = 0.0025
"""Of a wheel's radius: tyre pressure and load, under which it is neither the radius that it rolls by nor the
height of the axle [R]."""
TURNS_BY: Final = (0.012, 0.01)
"""Of the steer: by what share tyres of a round section and of a camber of their own turn a bicycle more than
wheels that are thin and roll where they point, and give or take how much: the side force of a wheel that is
cambered as it is steered alone turns it by a fiftieth more [R; 54 healthy rides of four worlds of others, all
on tyres that slip, turn by 0 to 3 % more and by none less]."""
TURNS_LATE_S: Final = (0.006, 0.004)
"""By how much a bicycle turns later than it is steered, and give or take how much: a tyre takes its side
force up within some decimetres [R; those rides: 1 to 11 ms]; none lets it turn earlier."""
CREEPS: Final = (0.003, 0.002)
"""s²/m: share of its way that the rear wheel turns further for each m/s² that it drives with, and give or
take how much [R: it bears three fifths of the weight, and tyres slip by a thirtieth under as much force as
they bear]."""
ROLLING: Final = 0.5
"""Of these, how far they go with speed, load and road."""
IMU_BIAS: Final = 0.5
"""Of one sample's noise: what is left after zeroing at rest [R]. What a calibrated scale is off by is left of
gravity besides."""
SCALE: Final = 0.002
"""Of a sensor's scale, as data sheets of calibrated ones have it [R]."""
MISALIGNMENT: Final = 0.003
"""rad: of a sensor that was screwed on and calibrated [R]."""
ASIDE: Final = 2.5
"""N m of lean torque: half a centimetre by which a rider sits to one side [R]."""
ROUND_M: Final = (0.012, 0.008)
"""Radius of a tyre's section, on whose flank a leaning bicycle rolls, and give or take how much [R: tyres are
25 to 50 mm wide; a file's heights may be off as well]."""
LATENCY_S: Final = 0.0015
"""A tenth of the ride's sample and more: nodes and IMU keep their own time [R]."""
STIFF_FORK: Final = (6e3, 2e4, 6e4)
"""N/m: a mountain bicycle's fork to a road bicycle's."""
STIFF_TYRE: Final = (5e4, 1e5, 2e5)
DELAYS_S: Final = (0.005, 0.01, 0.02, 0.04, 0.08)
RATES: Final = (3e-4, 1e-3, 3e-3, 6e-3)
"""Of a clock, s/s: over a ride even small ones move signals by more than any linear picture holds."""


def ride_nuisances(rig: BicycleFile, problem: Problem) -> tuple[Nuisance, ...]:
    """Zeros of lean and steer, wheel radius, how tyres turn and roll, how the rider sits, the IMU's biases,
    mounting and time."""
    (turns, give), (late_s, give_s), (creeps, spread) = TURNS_BY, TURNS_LATE_S, CREEPS
    out = [
        Nuisance("lean.sensor_bias.offset", LEAN_ZERO, "rad"),
        Nuisance("steer.sensor_bias.offset", STEER_ZERO, "rad"),
        Nuisance("rear_wheel.wheel_radius.scale", RADIUS, "1"),
        Nuisance("rear_wheel.drive_slip.per_accel", spread, "s²/m", mean=creeps, drift=ROLLING),
        Nuisance("steer.sensor_scale.scale", give, "1", mean=-turns, drift=ROLLING),
        Nuisance("steer.sensor_latency.delay", give_s, "s", mean=-late_s, drift=ROLLING),
    ]
    if LEAN_TORQUE in problem.signals:
        out.append(Nuisance(f"{LEAN_TORQUE}.sensor_bias.offset", ASIDE, "N·m"))
        section_m, spread_m = ROUND_M
        out.append(Nuisance(f"{LEAN_TORQUE}.tyre_section.radius", spread_m, "m", mean=section_m))
    channels = [s for s in problem.signals if s.startswith("imu.")]
    for s in channels:
        noise = rig.noise.gyro if s.startswith("imu.gyro") else rig.noise.accel
        carried = [np.mean(problem.measured[x.part]) for x in problem.series if x.signal == s]
        sd = float(np.hypot(IMU_BIAS * noise, SCALE * np.mean(carried)))
        unit = quantity_unit(s.removeprefix("imu."))
        out.append(Nuisance(f"{s}.sensor_bias.offset", sd, unit, drift=SWITCHED_ON))
    out += [Nuisance(f"imu.sensor_misalignment.{c}", MISALIGNMENT, "rad") for c in "xyz"]
    out.append(Nuisance("imu.sensor_latency.delay", LATENCY_S, "s"))
    return tuple(out)


def ride_leaves(problem: Problem, without: Collection[str] = ()) -> list[Leaf]:
    """Every effect of the bicycle's part of the catalogue that these rides could show."""
    out = [
        _compliant("front_suspension", STIFF_FORK, 400.0),
        _compliant("tyre_compliance", STIFF_TYRE, 250.0),
        _rear_wheel(),
        _leaf("wheel_radius", "front_wheel", ("scale",), [({"scale": 1.01},)]),
        _leaf("wheel_slip", "rear_wheel", ("coefficient",), [({"coefficient": 0.01},)]),
    ]
    if LEAN_TORQUE in problem.signals:
        prefix = "bicycle.rider_motion."
        starts = [Start({}, ({f"{prefix}gain": 0.2},))]
        starts += [
            Start({f"{prefix}damping": 100.0}, ({f"{prefix}stiffness": k},))
            for k in (600.0, 2500.0)
        ]
        names = tuple(f"{prefix}{p}" for p in ("stiffness", "damping", "gain"))
        out.append(Leaf("rider_motion", "bicycle", names, tuple(starts), None))
    for s in SIGNALS:
        out += _sensor(s, 0.01)
    channels = [s for s in problem.signals if s.startswith("imu.")]
    for s in channels:
        out += _sensor(s, problem.table[f"{s}.sensor_bias.offset"].scale)
    if channels:
        out.append(_leaf("sensor_latency", "imu", ("delay",), [({"delay": d},) for d in DELAYS_S]))
        out.append(_leaf("sensor_scale", "imu", ("scale",), [({"scale": 1.02},)]))
        turns: tuple[Changes, ...] = tuple({c: 0.02} for c in "xyz")
        out.append(_leaf("sensor_misalignment", "imu", ("x", "y", "z"), [turns]))
        drifts: list[tuple[Changes, ...]] = [({"rate": w * r},) for r in RATES for w in (1.0, -1.0)]
        out.append(_leaf("clock_drift", "imu", ("rate",), drifts))
    return [leaf for leaf in out if leaf.effect not in without]


def _rear_wheel() -> Leaf:
    """Of another radius, on which the frame stands higher, or which the rig file has wrong."""
    scale, frame = (f"rear_wheel.wheel_radius.{name}" for name in ("scale", "frame"))
    starts = (Start({}, ({scale: 1.01},)), Start({frame: 0.0}, ({scale: 1.01},)))
    return Leaf("wheel_radius", "rear_wheel", (scale, frame), starts, None)


def _compliant(effect: str, stiffness: Collection[float], damping: float) -> Leaf:
    prefix = f"bicycle.{effect}."
    starts = tuple(
        Start({f"{prefix}damping": damping}, ({f"{prefix}stiffness": k},)) for k in stiffness
    )
    return Leaf(effect, "bicycle", (f"{prefix}stiffness", f"{prefix}damping"), starts, None)


def _leaf(
    effect: str, location: str, parameters: tuple[str, ...], starts: list[tuple[Changes, ...]]
) -> Leaf:
    prefix = f"{location}.{effect}."
    made = tuple(
        Start({}, tuple({prefix + k: v for k, v in column.items()} for column in columns))
        for columns in starts
    )
    return Leaf(effect, location, tuple(prefix + p for p in parameters), made, None)


def _sensor(signal: str, size: float) -> list[Leaf]:
    return [
        _leaf("sensor_bias", signal, ("offset",), [({"offset": size},)]),
        _leaf("sensor_scale", signal, ("scale",), [({"scale": 1.02},)]),
        _leaf("sensor_latency", signal, ("delay",), [({"delay": d},) for d in DELAYS_S]),
    ]
