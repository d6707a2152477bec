"""Where everything stands in the flat arrays of the compiled model: parameters, model, state, outputs.

Parameters: n actuator blocks (effects, then four effects for each answered quantity), then platform,
IMU channels, whole IMU, clocks, bus, and six coordinates of the joints of each actuator.
Model: header, actuators' constants (rows of n), geometry twice (with and without effects), body twice,
gravity twice, legs twice (as they are, as drives know them), IMU. State: rows of n, then twelve values of
the IMU filter, six of its mount, and the tick.
"""

from __future__ import annotations

from hil.sim.catalogue import (
    ACTUATOR,
    MISALIGNMENT,
    PLATFORM,
    QUANTITIES,
    index,
    sensor_effects,
    size,
)


def _a(effect: str, parameter: str) -> int:
    return index(ACTUATOR, effect, parameter)


# --- parameters -------------------------------------------------------------------------------------
P_COULOMB = _a("coulomb_friction", "force")
P_PRESLIDING = _a("coulomb_friction", "presliding")
P_VISCOUS = _a("viscous_friction", "coefficient")
P_STRIBECK_C = _a("stribeck_friction", "coulomb")
P_STRIBECK_S = _a("stribeck_friction", "static")
P_STRIBECK_V = _a("stribeck_friction", "velocity")
P_ASYM_POS = _a("asymmetric_friction", "positive")
P_ASYM_NEG = _a("asymmetric_friction", "negative")
P_ASYM_VISCOUS_POS = _a("asymmetric_viscous_friction", "positive")
P_ASYM_VISCOUS_NEG = _a("asymmetric_viscous_friction", "negative")
P_LOAD = _a("load_friction", "coefficient")
P_LOAD_ASYM = _a("load_friction", "asymmetry")
P_GAP = _a("backlash", "gap")
P_HYST_F = _a("hysteresis", "force")
P_HYST_X = _a("hysteresis", "displacement")
P_STIFFNESS = _a("compliance", "stiffness")
P_DAMPING = _a("compliance", "damping")
P_HARDENING = _a("compliance", "hardening")
P_INERTIA = _a("actuator_inertia", "mass")
P_FMAX = _a("force_saturation", "limit")
P_FKNEE = _a("force_saturation", "knee")
P_VMAX = _a("velocity_saturation", "limit")
P_VKNEE = _a("velocity_saturation", "knee")
P_RIPPLE_A = _a("force_ripple", "amplitude")
P_RIPPLE_P = _a("force_ripple", "period")
P_RIPPLE_PHASE = _a("force_ripple", "phase")
P_FORCE_SCALE = _a("force_constant", "scale")
P_KP = _a("loop_gain", "position")
P_KV = _a("loop_gain", "speed")
P_KI = _a("loop_gain", "integral")
P_DELAY = _a("transport_delay", "delay")
P_OFFSET = _a("position_offset", "offset")
P_LEAD = _a("lead_error", "scale")
P_LEAD_A = _a("lead_error", "amplitude")
P_LEAD_P = _a("lead_error", "period")
P_LEAD_PHASE = _a("lead_error", "phase")
ACTUATOR_SIZE = size(ACTUATOR)

_SENSOR = sensor_effects("", 1.0)
SENSOR_SIZE = size(_SENSOR)
BIAS = index(_SENSOR, "sensor_bias", "offset")
SCALE = index(_SENSOR, "sensor_scale", "scale")
LATENCY = index(_SENSOR, "sensor_latency", "delay")
QUANTUM = index(_SENSOR, "sensor_quantisation", "step")

ACTUATOR_BLOCK = ACTUATOR_SIZE + len(QUANTITIES) * SENSOR_SIZE
"""Parameters of one actuator; quantity k's sensor parameters start at ACTUATOR_SIZE + k SENSOR_SIZE."""

PL_MASS = index(PLATFORM, "payload_mass", "mass")
PL_COG = index(PLATFORM, "payload_cog", "x")
PL_INERTIA = index(PLATFORM, "payload_inertia", "xx")
PL_STATIC = index(PLATFORM, "static_force_feedback", "scale")
PL_TILT = index(PLATFORM, "base_tilt", "roll")
IMU_AT = size(PLATFORM)
"""Offsets from the platform block: six channels, then the whole IMU, misalignment, clocks, bus, joints."""
IMU_WHOLE_AT = IMU_AT + 6 * SENSOR_SIZE
MISALIGNMENT_AT = IMU_WHOLE_AT + SENSOR_SIZE
CLOCK_AT = MISALIGNMENT_AT + size(MISALIGNMENT)
BUS_AT = CLOCK_AT + 2
JOINTS_AT = BUS_AT + 2

# --- model ------------------------------------------------------------------------------------------
H_KIND, H_N, H_DT, H_POSITION_TICKS, H_CYCLE, H_SETPOINT_DELAY, H_LINEAR, H_RETIMED = range(8)
(
    H_SUBSTEPS,
    H_GEOMETRY,
    H_IMU,
    H_STATIC_FF,
    H_IMU_DELAY,
    H_ANSWER_DELAY,
    H_SMOOTH,
    H_FORCE_LINEAR,
    H_CLOCK_WAIT,
    H_EARLIER,
) = range(8, 18)
HEADER = 18
"""Header: kind, n, s per tick, ticks per position loop, s per cycle, s, flags, steps per tick, length of
the geometry, whether there is an IMU, whether a static-force feed-forward acts, the group delay left in
the IMU's answers s, delay of the drives' answers s, whose arrivals act between ticks, whether forces that
drives are told are drawn out in lines, how long the first drive waits for its clock s, and
how much less than the one before it each of the others s."""
NONE_SMOOTH, ALL_SMOOTH, TICKED_SMOOTH = 0.0, 1.0, 2.0
"""Values of H_SMOOTH; the last: arrivals at drives whose own ticks are known."""
RESTS = 2.0
LEADS = 3.0
INTERPOLATIONS = {"hold": 0.0, "linear": 1.0, "linear_rests": RESTS, "linear_leads": LEADS}
"""Values of H_LINEAR."""

(
    A_REFLECTED, A_VISCOUS, A_COULOMB_POS, A_COULOMB_NEG, A_VMAX, A_FMAX, A_LOWER, A_UPPER, A_HOME,
    A_KP, A_KV, A_KI, A_KFV, A_KFA, A_KFF, A_MEFF, A_CURRENT_DECAY, A_CURRENT_MEAN, A_STATIC_FF, A_PD,
    A_FORCE_PER_A, A_BRAKE, A_FF_VISCOUS, A_FF_COULOMB, A_STRIBECK_C, A_STRIBECK_D, A_STRIBECK_V, A_LOAD,
    A_LOAD_ASYM, A_GAP, A_HYST_F, A_HYST_X, A_STIFFNESS, A_DAMPING, A_RIPPLE_A, A_RIPPLE_P, A_RIPPLE_PHASE,
    A_FORCE_SCALE, A_DELAY, A_OFFSET, A_PER_LEAD, A_LEAD_A, A_LEAD_P, A_LEAD_PHASE, A_HARDENING,
    A_VISCOUS_SKEW, A_PRESLIDING, A_FKNEE, A_VKNEE, A_GUIDE,
) = range(50)  # fmt: skip
A_ROWS = 50
"""Rows of the actuators' constants, SI at the output; A_STRIBECK_D is static minus Coulomb friction,
A_HARDENING how much a transmission stiffens with the square of its wind-up, 1/m²; A_VISCOUS_SKEW what viscous
friction is more in the positive direction than its mean, A_PRESLIDING the way within which friction builds
up, m; A_CURRENT_DECAY what a step of integration leaves of the current loop's lag, A_CURRENT_MEAN the lag's
mean over the step; A_PER_LEAD what the encoder reads of a metre; A_FKNEE, A_VKNEE how softly force and speed
reference bend over to their limits; A_GUIDE Coulomb friction that rubs on the load, N."""

BODY, GRAVITY, LEG, IMU = 10, 3, 6, 17
"""Lengths; IMU: position (3), rotation sensor → platform (9), filter Hz, mount Hz (3), its damping ratio."""

# --- state ------------------------------------------------------------------------------------------
(
    S_Q, S_QD, S_QDD, S_VM, S_RATE, S_RHO, S_WINDUP, S_CONTACT, S_HYST, S_SLIP, S_FRICTION, S_LOAD,
    S_CURRENT, S_FREF, S_INTEGRAL, S_VREF, S_FF, S_X0, S_X1, S_T0, S_T1, S_SLOPE, S_AREF,
    S_MODE, S_BRAKE, S_PENDING, S_PENDING_T, S_HAS_PENDING,
    S_FIFO, S_FIFO_1, S_FIFO_2, S_FIFO_3, S_FIFO_T, S_FIFO_T1, S_FIFO_T2, S_FIFO_T3, S_FIFO_N,
    S_PLAY, S_IDLE, S_STATIC, S_XD, S_VD, S_BRISTLE, S_PULL, S_GUIDE,
    S_TICKED, S_PHASE, S_VHELD, S_FHELD,
) = range(49)  # fmt: skip
S_ROWS = 49
"""Rows of the state: pose, its rates; motor velocity, actuator rate and position; wind-up of motor against
load, contact, hysteresis, slip direction, friction force, transmitted force; current's force, force
reference, integrator, speed reference, pre-control; segment of the setpoint, position or force; mode,
brake; setpoints that wait; static force of the pose; position and velocity as the drive's encoder gives
them; force of bent bristles; acceleration that leads a replay to what was measured; force of the bristles
of the load's guides; whether setpoints reach a smooth twin's drive as its own ticks take them, and where in
the model's steps its position loop then has its own; speed reference and pre-control that it has set last."""
S_TAIL = 19
"""Twelve values of the IMU filter, six of its mount, then the tick."""

MODE_OFF, MODE_POSITION, MODE_FORCE = 0, 1, 2

assert (BIAS, SCALE, LATENCY, QUANTUM) == (0, 1, 2, 3)
