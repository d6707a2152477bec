"""Columns of the table of actuators: SI at the output, neutral where an effect is absent."""

from __future__ import annotations

from typing import Final

import numpy as np

(
    REFLECTED,  # kg, rotor mass at the output
    VISCOUS,  # N·s/m on the motor's side
    COULOMB_POS,  # N, motion towards plus
    COULOMB_NEG,  # N, motion towards minus
    STATIC_EXTRA,  # N above Coulomb at standstill
    STRIBECK_V,  # m/s
    STRIBECK_POWER,  # exponent of |v / v_s|
    LOAD_AGAINST,  # friction per newton carried while the motor drives the load
    LOAD_WITH,  # the same while the load drives the motor
    LAW,  # 0: four Maxwell slip elements, 1: LuGre bristles
    PRESLIDING,  # m
    HYST_FORCE,  # N
    HYST_D,  # m
    HYST_POWER,  # 1: Dahl, 2: Bouc-Wen
    STIFFNESS,  # N/m between motor and load
    DAMPING,  # N·s/m, beside it
    GAP,  # m, whole play
    FLANK,  # m over which a flank takes hold
    FORCE_LIMIT,  # N
    SPEED_LIMIT,  # m/s
    RIPPLE,  # N
    RIPPLE_PERIOD,  # m
    RIPPLE_PHASE,  # rad
    RIPPLE_SECOND,  # second harmonic over the first
    TORQUE,  # true over reported force
    POSITION_GAIN,  # 1/s
    SPEED_GAIN,  # N·s/m
    INTEGRAL_GAIN,  # N/m
    CURRENT_HZ,  # Hz
    SPEED_FILTER,  # s, lag of the drive's speed signal
    ENCODER_STEP,  # m
    LEAD,  # true over counted travel, about home
    LEAD_AMPLITUDE,  # m
    LEAD_PERIOD,  # m
    LEAD_PHASE,  # rad
    OFFSET,  # m, true minus counted position
    HOME,  # m
    SETPOINT_DELAY,  # s, frame sent to drive
    LOAD_VISCOUS,  # N·s/m on the load's side
    WARM,  # fault: share by which friction changes while the rig runs
    WARM_TAU,  # s
    SPOT,  # fault: N of friction at one place
    SPOT_X,  # m
    SPOT_WIDTH,  # m
    DROPOUT,  # fault: 1 where the drive loses torque by the run's dropout plan
    STOP_X,  # fault: m, where a rubber stop begins
    STOP_K,  # N/m
    CABLE_K,  # fault: N/m of a cable or belt that pulls
    CABLE_X,  # m
    PUMP,  # fault: N, periodic in time
    PUMP_HZ,  # Hz
    PUMP_PHASE,  # rad
    DRAG,  # fault: N·s²/m²
    POWER,  # W, fault: what the supply gives
    SCHEDULE,  # fault: share of speed gain lost below SCHEDULE_V
    SCHEDULE_V,  # m/s
    BRAKE,  # fault: N of a brake that lets go late
    SLIP,  # N, fault: a coupling slips above it
    COUNT,
) = range(59)

NEUTRAL: Final = np.zeros(COUNT)
for _column, _value in (
    (STRIBECK_V, 0.003),
    (STRIBECK_POWER, 1.0),
    (PRESLIDING, 1e-5),
    (HYST_D, 1e-3),
    (HYST_POWER, 1.0),
    (RIPPLE_PERIOD, 0.005),
    (TORQUE, 1.0),
    (LEAD, 1.0),
    (LEAD_PERIOD, 0.005),
    (WARM_TAU, 10.0),
    (SPOT_WIDTH, 0.01),
    (STOP_X, np.inf),
    (POWER, np.inf),
    (SLIP, np.inf),
):
    NEUTRAL[_column] = _value
NEUTRAL.flags.writeable = False
