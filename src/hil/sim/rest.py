"""The rig at rest: the pose in which drives that hold their positions, or brakes, carry all loads."""

from __future__ import annotations

import math

import numpy as np

from hil.compiled import compiled, inner
from hil.rigs.kernel import scratch, terms_in
from hil.rigs.linear import solve_square
from hil.sim import layout as lay
from hil.sim.drive_loops import encoder, set_mode
from hil.sim.imu import measure
from hil.sim.mechanics import ALWAYS, RIGID
from hil.sim.model import split
from hil.sim.statics import static_forces, statics_memory

EVALUATIONS = 80
REST_M = 1e-3
"""A position error at rest above this is no rest: the mechanism cannot close there. A smaller one (a drive
that hunts over its own torque ripple) settles within a moment."""


@compiled
def state_size(n):  # type: ignore[no-untyped-def]
    """Length of the state of a rig with n actuators."""
    return lay.S_ROWS * n + lay.S_TAIL


@inner
def read_encoders(act, st):  # type: ignore[no-untyped-def]
    """Position and velocity of each motor as its drive sees them, into the state."""
    for i in range(st.shape[1]):
        x, ratio = encoder(act, i, st[lay.S_RHO, i] + st[lay.S_WINDUP, i])
        st[lay.S_XD, i] = x
        st[lay.S_VD, i] = ratio * st[lay.S_VM, i]


@inner
def _windup(linear, hardening):  # type: ignore[no-untyped-def]
    """Wind-up e of a spring that stiffens with its square: e + hardening e³ = `linear`, wind-up without."""
    if hardening <= 0.0:
        return linear
    width = math.sqrt(0.75 * hardening)
    return math.sinh(math.asinh(3.0 * width * linear) / 3.0) / width


@inner
def _at_rest(act, st, i, load):  # type: ignore[no-untyped-def]
    """Wind-up, encoder reading, its slope and current's force of actuator i that carry the static `load` (N)
    without friction. A load below 1 N does not press the flanks together: the motor stands within the gap."""
    e = 0.5 * act[lay.A_GAP, i] * min(max(load, -1.0), 1.0)
    if act[lay.A_STIFFNESS, i] != math.inf:
        e += _windup(load / act[lay.A_STIFFNESS, i], act[lay.A_HARDENING, i])
    x = st[lay.S_RHO, i] + e
    reading, ratio = encoder(act, i, x)
    ripple = 0.0
    if act[lay.A_RIPPLE_A, i] != 0.0:
        turn = 2.0 * math.pi * (x - act[lay.A_HOME, i]) / act[lay.A_RIPPLE_P, i]
        ripple = act[lay.A_RIPPLE_A, i] * math.sin(turn + act[lay.A_RIPPLE_PHASE, i])
    return e, reading, ratio, (load - ripple) / (act[lay.A_FORCE_SCALE, i] * ratio)


@compiled
def _unbalanced(model, views, st, modes, target, own, M, J, A, load, nominal, b):  # type: ignore[no-untyped-def]
    """Evaluate the pose in the state: fills J, load, wind-up and current; b (n,) is what each actuator's
    position lacks, divided by the slope of its encoder. Returns the largest lack, m."""
    act, geometry, geometry0, body, body0, gravity, gravity0, legs, legs0, _ = views
    kind, n = int(model[lay.H_KIND]), st.shape[1]
    still, jdqd, q = np.zeros(n), np.empty(n), st[lay.S_Q]
    rho = st[lay.S_RHO]
    terms_in(own, kind, geometry, body, legs, gravity, q, still, M, load, rho, J, jdqd)
    for i in range(n):
        for j in range(n):
            A[i, j] = J[j, i]
    solve_square(A, load)
    if model[lay.H_STATIC_FF] != 0.0:
        static_forces(statics_memory(n), kind, geometry0, body0, legs0, gravity0, q, nominal)
    worst = 0.0
    for i in range(n):
        e, reading, ratio, force = _at_rest(act, st, i, load[i])
        st[lay.S_WINDUP, i] = e
        st[lay.S_CURRENT, i] = force
        b[i] = target[i] - reading
        if act[lay.A_PD, i] != 0.0 and modes[i] == lay.MODE_POSITION:
            b[i] -= (force - act[lay.A_STATIC_FF, i] * nominal[i]) / act[lay.A_KP, i]
        worst = max(worst, abs(b[i]))
        b[i] /= ratio
    return worst


@compiled
def rest(model, target, modes, q_guess, state):  # type: ignore[no-untyped-def]
    """Fill `state` with the rig at rest at tick 0, each drive at position (reference) target (n,).

    `modes` (n,): the drives' modes; integrators carry the static load, or brakes do. In "pd" law the
    drive's error is what its law needs. Newton's method on the positions, with half steps where a full one
    makes it worse. Returns the largest position error left, m: above REST_M there is no such rest.
    """
    n = int(model[lay.H_N])
    views = split(model, n)
    act, gravity, imu = views[0], views[5], views[9]
    for c in range(state.shape[0]):
        state[c] = 0.0
    st = state[: lay.S_ROWS * n].reshape((lay.S_ROWS, n))
    tail = state[lay.S_ROWS * n :]
    M, J, A, own = np.empty((n, n)), np.empty((n, n)), np.empty((n, n)), scratch(n)
    load, nominal, b = np.empty(n), np.zeros(n), np.empty(n)
    best, way = np.empty(n), np.zeros(n)
    error, share = math.inf, 1.0
    for a in range(n):
        best[a] = q_guess[a]
        st[lay.S_Q, a] = q_guess[a]
    for _ in range(EVALUATIONS):
        worst = _unbalanced(model, views, st, modes, target, own, M, J, A, load, nominal, b)
        if worst < error:
            error, share = worst, 1.0
            for i in range(n):
                best[i] = st[lay.S_Q, i]
                way[i] = b[i]
                for j in range(n):
                    A[i, j] = J[i, j]
            if error < 1e-14:
                break
            solve_square(A, way)
        else:
            share *= 0.5
            if share < 1e-3:
                break
        for a in range(n):
            st[lay.S_Q, a] = best[a] + share * way[a]
    for a in range(n):
        st[lay.S_Q, a] = best[a]
    error = _unbalanced(model, views, st, modes, target, own, M, J, A, load, nominal, b)
    for i in range(n):
        if act[lay.A_GAP, i] > 0.0:
            st[lay.S_CONTACT, i] = math.copysign(1.0, load[i]) if abs(load[i]) >= 1.0 else 0.0
        else:
            st[lay.S_CONTACT, i] = RIGID if act[lay.A_STIFFNESS, i] == math.inf else ALWAYS
        st[lay.S_LOAD, i] = load[i]
        st[lay.S_STATIC, i] = nominal[i]
    read_encoders(act, st)
    for i in range(n):
        if modes[i] == lay.MODE_OFF:
            st[lay.S_CURRENT, i] = 0.0
        force = st[lay.S_CURRENT, i]
        set_mode(act, st, i, int(modes[i]))
        st[lay.S_FREF, i] = force
        if modes[i] == lay.MODE_FORCE:
            st[lay.S_X1, i] = force
            st[lay.S_BRAKE, i] = 0.0
        elif modes[i] == lay.MODE_POSITION:
            st[lay.S_X0, i] = target[i]
            st[lay.S_X1, i] = target[i]
    if model[lay.H_IMU] != 0.0:
        measure(own[0], own[1], own[2], gravity, imu, np.zeros(n), np.zeros(n), tail[:6])
        for a in range(3):
            tail[12 + a] = tail[3 + a]
    return error
