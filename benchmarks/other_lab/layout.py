"""Rows of the actuators' constants and places in the global constants of the compiled plant.

All SI at the actuator's output. Neutral values of everything that is no property of a healthy rig stand in
`NEUTRAL`.
"""

(
    MR, VIS, COUL_P, COUL_N, STAT, VSTR, SHAPE, LAW, SIG0, SIG1, LOADMU,
    KT, DT, GAP, HYS_F, HYS_D, HYS_N, RIP_A, RIP_P, RIP_PH, KF,
    KP, KV, KI, VMAX, FMAX, CUR_W, CUR_Z, HOME, OFFSET, LEAD, LEAD_A, LEAD_P, LEAD_PH,
    WARM, WARM_TAU, THR_S, THR_F, CAB_F, CAB_X, CAB_K, NB0, NB1, NB2, NA1, NA2,
    BEAR_A, BEAR_P, BRAKE_F, SUP_A, SUP_HZ, TICK_AT,
) = range(52)  # fmt: skip
ACT_ROWS = 52
"""Motor: reflected mass, viscous, Coulomb either way, static excess, Stribeck speed, its shape's code,
friction law, its two own constants, load friction. Transmission: stiffness, damping, gap; hysteresis; ripple;
force per reported force. Drive: gains, limits, current loop; encoder: home, offset, lead. Faults outside the
catalogue: warm friction, throttle, cable, notch, bearing, brake, supply. Tick of the position loop."""

NEUTRAL = {
    VSTR: 0.01, HYS_D: 1e-3, HYS_N: 1.0, RIP_P: 5e-3, KF: 1.0, LEAD: 1.0, LEAD_P: 5e-3,
    WARM_TAU: 5.0, THR_F: 1e9, NB0: 1.0, BEAR_P: 5e-3, SUP_HZ: 50.0,
}  # fmt: skip

LUGRE, MAXWELL, TANH = 0, 1, 2
"""Friction laws."""

CYCLE, TICK, START, SUBSTEPS, BASE_M, BASE_W, BASE_Z, SIDE_M, SIDE_W, SIDE_Z = range(10)
GLOBALS = 10
"""Bus cycle, period of the speed loop by the drives' clock, first instant; floor on a spring (mass, rad/s,
damping ratio); a small mass that swings at the platform's centre of gravity, likewise."""

POSITION_TICKS = 4
"""Ticks of the speed loop in one of the position loop."""
