"""Rows of the exam world's flat arrays: what an actuator has, what its state is, what happens outside.

SI at the actuator's output, as everywhere. Nothing here is shared with the twin's own layout.
"""

from __future__ import annotations

# --- header -----------------------------------------------------------------------------------------
(
    H_KIND, H_STEP, H_CYCLE, H_RETIMED, H_LINEAR, H_PD, H_IMU, H_BANDWIDTH, H_SETTLE,
    H_MODE_M, H_MODE_W, H_MODE_D, H_MODE_X, H_MODE_Y, H_MODE_Z,
    H_SLOSH_M, H_SLOSH_W, H_SLOSH_D, H_SLOSH_X, H_SLOSH_Y, H_SLOSH_Z,
    H_BASE_RATIO, H_BASE_W, H_BASE_D,
    H_LOSS_F, H_LOSS_T1, H_LOSS_T2, H_LOSS_PHASE,
    H_PUSH_F, H_PUSH_W, H_PUSH_PHASE, H_PUSH_X, H_PUSH_Y, H_PUSH_Z, H_FORCES, H_FORCE_LINEAR,
) = range(36)  # fmt: skip
HEADER = 36
"""Kind of mechanism, integration step s, bus cycle s, whether setpoints are
buffered, drawn out in lines, law "pd", IMU wanted, its bandwidth rad/s, time to settle before 0 s; the
structural mode (mass kg, rad/s, damping ratio, place); slosh alike; the base frame on springs (mass ratio,
rad/s, damping ratio); a counterbalance that fails now and then (N, two periods s, phase); a periodic push
(N, rad/s, phase, direction); whether the drives are told forces, and whether they draw those out in lines."""

# --- actuators --------------------------------------------------------------------------------------
(
    A_MASS, A_VISCOUS, A_COULOMB, A_POSITIVE, A_NEGATIVE, A_STRIBECK, A_STRIBECK_V, A_LOAD, A_LOAD_ASYM,
    A_BRISTLE, A_FRICTION_V, A_FRICTION_X, A_FRICTION_L, A_FRICTION_PHASE,
    A_STIFFNESS, A_DAMPING, A_HARDENING, A_GAP, A_HYST_F, A_HYST_X, A_HYST_N, A_HYST_B,
    A_RIPPLE_A, A_RIPPLE_P, A_RIPPLE_PHASE, A_RIPPLE_2, A_OWN_RIPPLE_A, A_OWN_RIPPLE_P, A_OWN_RIPPLE_PHASE,
    A_FORCE_SCALE, A_FORCE_LIMIT, A_FORCE_MAX, A_SPEED_LIMIT, A_SPEED_MAX, A_KP, A_KV, A_KI, A_KFV, A_KFA,
    A_KFF, A_FF_VISCOUS, A_FF_COULOMB, A_MEFF, A_CURRENT_W, A_STATIC, A_COUNT, A_SPEED_TAU,
    A_PHASE_P, A_PHASE_V, A_PERIOD_P, A_PERIOD_V, A_HOME, A_OFFSET, A_LEAD, A_LEAD_A, A_LEAD_P, A_PER_AMPERE,
    A_LOWER, A_UPPER,
    O_CABLE_K, O_CABLE_X, O_SEAL_F, O_SEAL_TAU, O_DRIFT_C, O_DRIFT_TAU, O_BUMP_F, O_BUMP_X, O_BUMP_W,
    O_QUADRATIC, O_CYCLE_F, O_CYCLE_W, O_COG_F, O_COG_P, O_COG_X, O_COG_L, O_ROUND, O_SLIP_X, O_SLIP_T,
    O_DERATE, O_DERATE_TAU,
) = range(80)  # fmt: skip
A_ROWS = 80
"""Rotor mass, friction laws, transmission, ripple, drive loops with their own tick phases and periods,
encoder; from O_CABLE_K on what no catalogue names."""

# --- state ------------------------------------------------------------------------------------------
(
    S_X, S_V, S_BRISTLE, S_HYST, S_CURRENT, S_FREF, S_INTEGRAL, S_VREF, S_FF, S_STATIC, S_READING, S_COUNT,
    S_SPEED, S_REF, S_SLOPE, S_LEFT, S_ACC, S_ACC_LEFT, S_NEXT_P, S_NEXT_V, S_PENDING, S_HAS_PENDING,
    S_FIFO, S_FIFO_1, S_FIFO_2, S_FIFO_3, S_FIFO_N, S_PLAY, S_IDLE, S_LOAD, S_REST, S_SEAL, S_SEAL_X, S_HEAT,
    S_TAU, S_NOW, S_HOST_E, S_HOST_ED, S_HOST_SUM, S_HOST_PUSH, S_HOST_T, S_HOST_HEARD, S_HOST_J,
) = range(43)  # fmt: skip
S_ROWS = 43
"""Motor, friction states, drive; S_REF where the line that is being drawn
will be at the next tick, S_NOW where it is, S_LEFT its ticks, S_LOAD the load as friction feels it
(lagged), S_REST time at rest, S_SEAL the seal's present grip, S_HEAT what derating has built up; from
S_HOST_E on what the host outside the drives knows (`outer`)."""
