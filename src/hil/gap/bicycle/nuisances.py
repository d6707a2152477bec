"""What a healthy bicycle and its ride are off the rig file by, which a calibration would set right first."""

from __future__ import annotations

from typing import Final

import numpy as np

from hil.config import BicycleFile
from hil.gap.bicycle.problem import RideProblem
from hil.gap.bicycle.twin import LEAN_TORQUE
from hil.gap.bicycle.wheels import Wheels
from hil.gap.catalogue.nuisances import SWITCHED_ON, Nuisance
from hil.units import quantity_unit

LEAN_ZERO: Final = 0.004
"""rad: how upright a bicycle is held when its inclinometer is zeroed [R]."""
STEER_ZERO: Final = 0.0013
"""rad: half a step of the encoder of the text's bicycle [R; of 80 healthy rides of others 0.0021 at most]."""
RADIUS: Final = 0.0025
"""Of a wheel's radius: tyre pressure and load, under which it is neither the radius that it rolls by nor the
height of the axle [R]."""
ROLLING: Final = 0.5
"""Of what wheels do, how far it goes with speed, load and road."""
IMU_BIAS: Final = 0.5
"""Of one sample's noise: what is left after zeroing at rest [R]. What a calibrated scale is off by is left of
gravity besides."""
SCALE: Final = 0.002
"""Of a sensor's scale, as data sheets of calibrated ones have it [R]."""
MISALIGNMENT: Final = 0.003
"""rad: of a sensor that was screwed on and calibrated [R]."""
ASIDE: Final = 2.5
"""N m of lean torque: half a centimetre by which a rider sits to one side [R]."""
LATENCY_S: Final = 0.0015
"""A tenth of the ride's sample and more: nodes and IMU keep their own time [R]."""


def ride_nuisances(rig: BicycleFile, problem: RideProblem) -> tuple[Nuisance, ...]:
    """Zeros of lean and steer, wheel radius, how tyres turn and roll, how the rider sits, the IMU's biases,
    mounting and time."""
    out = [
        Nuisance("lean.sensor_bias.offset", LEAN_ZERO, "rad"),
        Nuisance("steer.sensor_bias.offset", STEER_ZERO, "rad"),
        Nuisance("rear_wheel.wheel_radius.scale", RADIUS, "1"),
    ]
    if LEAN_TORQUE in problem.signals:
        out.append(Nuisance(f"{LEAN_TORQUE}.sensor_bias.offset", ASIDE, "N·m"))
    out += [n for n in wheel_nuisances(problem.wheels) if _is_seen(n, problem)]
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


def wheel_nuisances(wheels: Wheels) -> tuple[Nuisance, ...]:
    """What such wheels do."""
    (turns, give), (late_s, give_s) = wheels.turns_by, wheels.turns_late_s
    (creeps, spread), (section_m, spread_m) = wheels.creeps, wheels.round_m
    aside, spread_aside = wheels.aside
    section = f"{LEAN_TORQUE}.tyre_section.radius"
    return (
        Nuisance("rear_wheel.drive_slip.per_accel", spread, "s²/m", mean=creeps, drift=ROLLING),
        Nuisance(
            "rear_wheel.side_slip.per_accel", spread_aside, "rad·s²/m", mean=aside, drift=ROLLING
        ),
        Nuisance("steer.sensor_scale.scale", give, "1", mean=-turns, drift=ROLLING),
        Nuisance("steer.sensor_latency.delay", give_s, "s", mean=-late_s, drift=ROLLING),
        Nuisance(section, spread_m, "m", mean=section_m),
    )


def _is_seen(n: Nuisance, problem: RideProblem) -> bool:
    """Whether the rides could show it: a section shows in the lean torque alone."""
    return not n.name.startswith(LEAN_TORQUE) or LEAN_TORQUE in problem.signals
