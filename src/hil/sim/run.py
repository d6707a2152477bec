"""The whole rig in time, compiled: rest state, one tick of drives and plant, and runs up to an instant.

Tick k stands at k dt, dt the period of the speed loop. In a tick the drives take what has arrived, close
their loops on what their encoders say now, and the force that follows acts until the next tick.
"""

from __future__ import annotations

import math

import numpy as np

from hil.compiled import compiled
from hil.rigs.kernel import scratch, terms_in
from hil.sim import layout as lay
from hil.sim.drive_loops import (
    EPSILON_S,
    deliver,
    encoder,
    mean_force,
    position_loops,
    set_mode,
    speed_loops,
)
from hil.sim.imu import filter_coefficients, filter_step, measure
from hil.sim.mechanics import ALWAYS, RIGID, classify_contacts, memory, step
from hil.sim.model import split
from hil.sim.statics import solve_square, static_forces

NEWTON_STEPS = 40


@compiled
def state_size(n):  # type: ignore[no-untyped-def]
    """Length of the state of a rig with n actuators."""
    return lay.S_ROWS * n + lay.S_TAIL


@compiled
def read_encoders(act, st):  # type: ignore[no-untyped-def]
    """Position and velocity of each motor as its drive sees them, into the state."""
    for i in range(st.shape[1]):
        x, ratio = encoder(act, i, st[lay.S_RHO, i] + st[lay.S_WINDUP, i])
        st[lay.S_XD, i] = x
        st[lay.S_VD, i] = ratio * st[lay.S_VM, i]


@compiled
def put_outputs(st, tail, row):  # type: ignore[no-untyped-def]
    """One row of outputs (4 n + 6,): position, velocity, force as the drives see them, pose, IMU."""
    n = st.shape[1]
    for i in range(n):
        row[i] = st[lay.S_XD, i]
        row[n + i] = st[lay.S_VD, i]
        row[2 * n + i] = st[lay.S_CURRENT, i]
        row[3 * n + i] = st[lay.S_Q, i]
    for a in range(6):
        row[4 * n + a] = tail[a]


@compiled
def _at_rest(act, st, i, load):  # type: ignore[no-untyped-def]
    """Wind-up and current's force of actuator i that carry the static `load` (N) without friction."""
    e = 0.5 * act[lay.A_GAP, i] * (math.copysign(1.0, load) if load != 0.0 else 0.0)
    if act[lay.A_STIFFNESS, i] != math.inf:
        e += load / act[lay.A_STIFFNESS, i]
    x = st[lay.S_RHO, i] + e
    reading, ratio = encoder(act, i, x)
    ripple = 0.0
    if act[lay.A_RIPPLE_A, i] != 0.0:
        turn = 2.0 * math.pi * (x - act[lay.A_HOME, i]) / act[lay.A_RIPPLE_P, i]
        ripple = act[lay.A_RIPPLE_A, i] * math.sin(turn + act[lay.A_RIPPLE_PHASE, i])
    return e, reading, ratio, (load - ripple) / (act[lay.A_FORCE_SCALE, i] * ratio)


@compiled
def rest(model, target, modes, q_guess, state):  # type: ignore[no-untyped-def]
    """Fill `state` with the rig at rest at tick 0, each drive at position (reference) target (n,).

    `modes` (n,): the drives' modes; integrators carry the static load, or brakes do. In "pd" law the
    drive's error is what its law needs. Returns the largest position error left, m: not small where no
    pose closes the mechanism.
    """
    act, geometry, geometry0, body, body0, gravity, gravity0, legs, imu = split(model)
    kind, n = int(model[lay.H_KIND]), int(model[lay.H_N])
    state[:] = 0.0
    st = state[: lay.S_ROWS * n].reshape((lay.S_ROWS, n))
    tail = state[lay.S_ROWS * n :]
    q, still = st[lay.S_Q], np.zeros(n)
    for a in range(n):
        q[a] = q_guess[a]
    M, J, A, own = np.empty((n, n)), np.empty((n, n)), np.empty((n, n)), scratch(n)
    jdqd, load, nominal, b = np.empty(n), np.empty(n), np.zeros(n), np.empty(n)
    error = math.inf
    for _ in range(NEWTON_STEPS):
        terms_in(
            own, kind, geometry, body, legs, gravity, q, still, M, load, st[lay.S_RHO], J, jdqd
        )
        for i in range(n):
            for j in range(n):
                A[i, j] = J[j, i]
        solve_square(A, load)
        if model[lay.H_STATIC_FF] != 0.0:
            static_forces(kind, geometry0, body0, legs, gravity0, q, nominal)
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
        if not worst < 0.999 * error or worst > 10.0:
            break
        error = worst
        for i in range(n):
            for j in range(n):
                A[i, j] = J[i, j]
        solve_square(A, b)
        for i in range(n):
            q[i] += b[i]
    for i in range(n):
        sign = math.copysign(1.0, load[i]) if load[i] != 0.0 else 0.0
        st[lay.S_CONTACT, i] = sign if act[lay.A_GAP, i] > 0.0 else (
            RIGID if act[lay.A_STIFFNESS, i] == math.inf else ALWAYS
        )  # fmt: skip
        st[lay.S_LOAD, i] = load[i]
        st[lay.S_STATIC, i] = nominal[i]
    read_encoders(act, st)
    for i in range(n):
        if modes[i] == lay.MODE_OFF:
            st[lay.S_CURRENT, i] = 0.0
        force = st[lay.S_CURRENT, i]
        set_mode(st, i, int(modes[i]))
        st[lay.S_FREF, i] = force
        if modes[i] == lay.MODE_FORCE:
            st[lay.S_FORCE_SETPOINT, i] = force
            st[lay.S_BRAKE, i] = 0.0
        elif modes[i] == lay.MODE_POSITION:
            st[lay.S_X0, i] = target[i]
            st[lay.S_X1, i] = target[i]
    if model[lay.H_IMU] != 0.0:
        measure(own[0], own[1], own[2], gravity, imu, still, still, tail[:6])
    return error


@compiled
def tick_memory(model, imu):  # type: ignore[no-untyped-def]
    """What `tick` works in, kept by its caller: the mechanics' memory, forces (n,), mean rates (n,), the IMU
    filter's coefficients (4,) and input (6,)."""
    n = int(model[lay.H_N])
    coefficients = np.empty(4)
    if model[lay.H_IMU] != 0.0:
        filter_coefficients(imu[12], model[lay.H_DT] / model[lay.H_SUBSTEPS], coefficients)
    return memory(n), np.empty(n), np.empty(n), coefficients, np.empty(6)


@compiled
def tick(model, views, st, tail, mem, with_imu):  # type: ignore[no-untyped-def]
    """From the tick the state stands at to the next; `views` of the model, `mem` from `tick_memory`."""
    act, _, geometry0, _, body0, gravity, gravity0, legs, imu = views
    mechanics, force, rates, coefficients, sensed = mem
    kind, n = int(model[lay.H_KIND]), st.shape[1]
    k = tail[lay.S_TAIL - 1]
    t = k * model[lay.H_DT]
    substeps = int(model[lay.H_SUBSTEPS])
    if int(k) % int(model[lay.H_POSITION_TICKS]) == 0:
        if model[lay.H_STATIC_FF] != 0.0:
            static_forces(kind, geometry0, body0, legs, gravity0, st[lay.S_Q], st[lay.S_STATIC])
        position_loops(model, act, st, t)
    speed_loops(model, act, st, t)
    h = model[lay.H_DT] / substeps
    for _ in range(substeps):
        for i in range(n):
            force[i] = mean_force(act, st, i, h)
            rates[i] = st[lay.S_QD, i]
        step(kind, views, st, mechanics, force, h)
        if with_imu:
            for i in range(n):
                rates[i] = 0.5 * (rates[i] + st[lay.S_QD, i])
            R, A, twist = mechanics[4][0], mechanics[4][1], mechanics[4][2]
            measure(R, A, twist, gravity, imu, rates, st[lay.S_QDD], sensed)
            filter_step(coefficients, tail, sensed)
    read_encoders(act, st)
    tail[lay.S_TAIL - 1] = k + 1.0


@compiled
def advance(model, state, events, count, ring, to_s):  # type: ignore[no-untyped-def]
    """Run to the first tick at or after `to_s`; outputs of tick k go to ring[k % len(ring)].

    `events` (N, 3): arrival s, actuator, setpoint, of which the first `count` wait; those that arrive
    in time are delivered in their order. Returns how many still wait, moved to the front.
    """
    views = split(model)
    n = int(model[lay.H_N])
    st = state[: lay.S_ROWS * n].reshape((lay.S_ROWS, n))
    tail = state[lay.S_ROWS * n :]
    dt = model[lay.H_DT]
    k = int(tail[lay.S_TAIL - 1])
    if k * dt >= to_s - EPSILON_S:
        return count
    mem = tick_memory(model, views[8])
    with_imu = model[lay.H_IMU] != 0.0
    while k * dt < to_s - EPSILON_S:
        if count > 0:
            kept = 0
            for e in range(count):
                if events[e, 0] <= k * dt + EPSILON_S:
                    deliver(model, st, int(events[e, 1]), events[e, 2], events[e, 0])
                else:
                    for c in range(3):
                        events[kept, c] = events[e, c]
                    kept += 1
            count = kept
        tick(model, views, st, tail, mem, with_imu)
        k += 1
        put_outputs(st, tail, ring[k % ring.shape[0]])
    return count


@compiled
def change_mode(model, state, i, mode):  # type: ignore[no-untyped-def]
    """Switch drive i at the tick the state stands at, and sort transmissions by new constants."""
    n = int(model[lay.H_N])
    act = split(model)[0]
    st = state[: lay.S_ROWS * n].reshape((lay.S_ROWS, n))
    if mode >= 0:
        set_mode(st, i, mode)
    classify_contacts(act, st)


@compiled
def look_up(ring, tick_now, dt, t, column):  # type: ignore[no-untyped-def]
    """Output `column` at instant t by interpolation between ticks; the oldest kept where t is before it."""
    size = ring.shape[0]
    x = t / dt
    k = math.floor(x)
    oldest = max(tick_now - size + 1, 0)
    if k < oldest:
        return ring[oldest % size, column]
    if k >= tick_now:
        return ring[tick_now % size, column]
    a, b = ring[k % size, column], ring[(k + 1) % size, column]
    return a + (b - a) * (x - k)
