"""The exam's world in time, compiled: motors on springs before the mechanism, in small explicit steps.

Every motor is a mass of its own behind a transmission (spring, damper, gap), whatever the effects: nothing
is ever rigid. Semi-implicit Euler steps; mass matrix and Jacobian of the rigid mechanism come from the pure
kernel of `hil.rigs`, every other step. A small mass on springs rides on the platform as its structural
mode (`platform`).
"""

from __future__ import annotations

import math

import numpy as np

from hil.compiled import compiled, inner
from hil.exam.world import layout as lay
from hil.exam.world.drives import deliver, position_tick, read_encoder, speed_tick
from hil.exam.world.friction import bristle_force, hysteresis_force, seal_force
from hil.exam.world.outer import ask
from hil.exam.world.platform import base, pushed, rider, sense
from hil.rigs.kernel import scratch, terms_in
from hil.rigs.linear import solve_square

FREEZE = 2
"""Steps for which mass matrix and Jacobian are kept."""


@inner
def _transmitted(act, st, i, e, u):  # type: ignore[no-untyped-def]
    """Force that the wind-up e (m) of actuator i, with rate u, passes on to the mechanism."""
    gap = 0.5 * act[lay.A_GAP, i]
    if gap > 0.0:
        if abs(e) <= gap:
            return 0.0
        e -= math.copysign(gap, e)
    spring = act[lay.A_STIFFNESS, i] * e
    if act[lay.A_HARDENING, i] > 0.0:
        spring *= 1.0 + abs(e) / act[lay.A_HARDENING, i]
    force = spring + act[lay.A_DAMPING, i] * u
    if gap > 0.0 and force * e < 0.0:  # a flank pushes, it never pulls
        return 0.0
    return force


@inner
def _resisting(act, st, i, t, h):  # type: ignore[no-untyped-def]
    """Force on motor i against positive motion, and force along it, beside current and transmission."""
    v, x = st[lay.S_V, i], st[lay.S_X, i]
    away = x - act[lay.A_HOME, i]
    force = -act[lay.A_VISCOUS, i] * v - bristle_force(act, st, i, h)
    if act[lay.A_HYST_F, i] != 0.0:
        force -= hysteresis_force(act, st, i, h)
    force += act[lay.A_OWN_RIPPLE_A, i] * math.sin(
        2.0 * math.pi * away / act[lay.A_OWN_RIPPLE_P, i] + act[lay.A_OWN_RIPPLE_PHASE, i]
    )
    if act[lay.A_RIPPLE_A, i] != 0.0:
        turn = 2.0 * math.pi * away / act[lay.A_RIPPLE_P, i] + act[lay.A_RIPPLE_PHASE, i]
        second = act[lay.A_RIPPLE_2, i] * math.sin(2.0 * turn + 0.7)
        force += act[lay.A_RIPPLE_A, i] * (math.sin(turn) + second)
    if act[lay.O_CABLE_K, i] != 0.0:
        pull = away - act[lay.O_CABLE_X, i]
        if pull > 0.0:
            force -= act[lay.O_CABLE_K, i] * pull * (1.0 + 4.0 * pull)
    if act[lay.O_SEAL_F, i] != 0.0:
        force -= seal_force(act, st, i, h)
    if act[lay.O_DRIFT_C, i] != 0.0:
        force -= act[lay.O_DRIFT_C, i] * math.exp(-max(t, 0.0) / act[lay.O_DRIFT_TAU, i]) * v
    if act[lay.O_BUMP_F, i] != 0.0:
        near = (away - act[lay.O_BUMP_X, i]) / act[lay.O_BUMP_W, i]
        force -= act[lay.O_BUMP_F, i] * math.exp(-near * near) * math.tanh(v / 2e-3)
    if act[lay.O_QUADRATIC, i] != 0.0:
        force -= act[lay.O_QUADRATIC, i] * v * abs(v)
    if act[lay.O_COG_F, i] != 0.0:
        swell = (away - act[lay.O_COG_X, i]) / act[lay.O_COG_L, i]
        force += act[lay.O_COG_F, i] * swell * math.sin(2.0 * math.pi * away / act[lay.O_COG_P, i])
    return force


@compiled
def _static_load(kind, geometry, body, legs, gravity, q, own, out):  # type: ignore[no-untyped-def]
    """Forces (n,) that hold the mechanism at q."""
    n = q.shape[0]
    M, J, T = np.empty((n, n)), np.empty((n, n)), np.empty((n, n))
    rho, jdqd, still = np.empty(n), np.empty(n), np.zeros(n)
    terms_in(own, kind, geometry, body, legs, gravity, q, still, M, out, rho, J, jdqd)
    for a in range(n):
        for b in range(n):
            T[a, b] = J[b, a]
    solve_square(T, out)


@inner
def _factor(M, L):  # type: ignore[no-untyped-def]
    """Lower Cholesky factor of M into L."""
    n = M.shape[0]
    for a in range(n):
        for b in range(a + 1):
            s = M[a, b]
            for c in range(b):
                s -= L[a, c] * L[b, c]
            L[a, b] = s / L[b, b] if b < a else math.sqrt(s)


@inner
def _back(L, x):  # type: ignore[no-untyped-def]
    """Solve L L^T x = x in place."""
    n = x.shape[0]
    for a in range(n):
        for c in range(a):
            x[a] -= L[a, c] * x[c]
        x[a] /= L[a, a]
    for a in range(n - 1, -1, -1):
        for c in range(a + 1, n):
            x[a] -= L[c, a] * x[c]
        x[a] /= L[a, a]


@inner
def _put(act, st, q, filtered, t, row):  # type: ignore[no-untyped-def]
    """Outputs (4 n + 6,): what each drive reads, its speed, its force, the pose, the IMU's filter."""
    n = q.shape[0]
    for i in range(n):
        row[i], _ = read_encoder(act, st, i, t)
        row[n + i] = st[lay.S_SPEED, i]
        row[2 * n + i] = st[lay.S_CURRENT, i]
        row[3 * n + i] = q[i]
    for c in range(6):
        row[4 * n + c] = filtered[c]


@compiled
def simulate(rig, start, events, asking, samples, out):  # type: ignore[no-untyped-def]
    """Run from rest, H_SETTLE before instant 0; fills out (N,). False where the world diverged.

    `rig`: header, actuators, (geometry, body, gravity) as they are and as the drives believe, legs, IMU.
    `start`: pose (n,) and setpoints (n,). `events`: firsts (n + 1,), arrivals s, setpoints; those of
    actuator i from firsts[i] to firsts[i + 1]. `samples` alike: firsts, true instants s, column a group.
    Where drives are told forces, `asking` is what the host works with (`outer.Asking`) and room for the
    forces that it tells (M,), and the setpoints are places in that.
    """
    head, act, true, nominal, legs, imu = rig
    q0, rho0 = start
    ev_first, ev_t, ev_value = events
    s_first, s_t, s_col = samples
    ask_first, ask_t, newest, age, wanted, known, masses, host, noise, told = asking
    is_told = head[lay.H_FORCES] != 0.0
    geometry, body, level_gravity = true
    kind, h, n = int(head[lay.H_KIND]), head[lay.H_STEP], q0.shape[0]
    st = np.zeros((lay.S_ROWS, n))
    own = scratch(n)
    M, J, L = np.empty((n, n)), np.empty((n, n)), np.zeros((n, n))
    bias, rho, jdqd, Q = np.empty(n), np.empty(n), np.empty(n), np.zeros(n)
    q, qd, qdd, rate = q0.copy(), np.zeros(n), np.zeros(n), np.zeros(n)
    gravity = level_gravity.copy()
    mode, slosh, frame = np.zeros(6), np.zeros(6), np.zeros(6)
    filtered, filter_rate, sensed = np.zeros(6), np.zeros(6), np.zeros(6)
    load, fed = np.empty(n), np.empty(n)
    _static_load(kind, nominal[0], nominal[1], nominal[3], nominal[2], q, own, fed)
    _static_load(kind, geometry, body, legs, gravity, q, own, load)
    terms_in(own, kind, geometry, body, legs, gravity, q, qd, M, bias, rho, J, jdqd)
    t = -head[lay.H_SETTLE]
    for i in range(n):
        gap = 0.5 * act[lay.A_GAP, i] * min(max(load[i], -1.0), 1.0)
        st[lay.S_X, i] = rho[i] + gap + load[i] / act[lay.A_STIFFNESS, i]
        st[lay.S_TAU, i] = load[i]
        st[lay.S_LOAD, i] = load[i]
        reading, _ = read_encoder(act, st, i, t)
        st[lay.S_COUNT, i] = math.floor(reading / act[lay.A_COUNT, i] + 0.5)
        st[lay.S_READING, i] = reading
        st[lay.S_NOW, i] = rho0[i]
        st[lay.S_IDLE, i] = 1.0
        st[lay.S_HOST_J, i] = -1.0
        carried = load[i] / act[lay.A_FORCE_SCALE, i]
        st[lay.S_INTEGRAL, i] = carried - act[lay.A_STATIC, i] * fed[i]
        st[lay.S_REF, i] = carried if is_told else rho0[i]
        st[lay.S_CURRENT, i] = carried
        st[lay.S_NEXT_P, i] = t + act[lay.A_PHASE_P, i]
        st[lay.S_NEXT_V, i] = t + act[lay.A_PHASE_V, i]
    groups = s_col.shape[0]
    at, ev, asked = s_first[:-1].copy(), ev_first[:-1].copy(), ask_first[:-1].copy()
    rows = np.zeros((2, 4 * n + 6))
    due = np.inf
    last = 0.0
    for g in range(groups):
        if at[g] < s_first[g + 1]:
            due = min(due, s_t[at[g]])
            last = max(last, s_t[s_first[g + 1] - 1])
    q_mid, qd_mid = np.empty(n), np.empty(n)
    step = 0
    while t <= last + h:
        for i in range(n):
            while asked[i] < ask_first[i + 1] and ask_t[asked[i]] <= t:
                k = asked[i]
                told[k] = ask(
                    st, i, k, ask_t[k], out, newest, age, wanted, known, masses, host, noise
                )
                asked[i] += 1
            while ev[i] < ev_first[i + 1] and ev_t[ev[i]] <= t:
                value = told[int(ev_value[ev[i]])] if is_told else ev_value[ev[i]]
                deliver(head, act, st, i, value, ev_t[ev[i]])
                ev[i] += 1
            if t >= st[lay.S_NEXT_P, i]:
                if act[lay.A_STATIC, i] != 0.0:
                    own_nominal = load
                    if i == 0:
                        _static_load(
                            kind,
                            nominal[0],
                            nominal[1],
                            nominal[3],
                            nominal[2],
                            q,
                            own,
                            own_nominal,
                        )
                    st[lay.S_STATIC, i] = own_nominal[i]
                position_tick(head, act, st, i, t)
                st[lay.S_NEXT_P, i] += act[lay.A_PERIOD_P, i]
            if t >= st[lay.S_NEXT_V, i]:
                speed_tick(head, act, st, i, t)
                st[lay.S_NEXT_V, i] += act[lay.A_PERIOD_V, i]
        if step % FREEZE == 0:
            ahead = 0.5 * FREEZE * h
            for a in range(n):
                q_mid[a] = q[a] + ahead * qd[a]
                qd_mid[a] = qd[a] + ahead * qdd[a]
            if head[lay.H_BASE_RATIO] != 0.0:
                base(head, level_gravity, qdd, own[1], own[2], FREEZE * h, frame, gravity)
            terms_in(own, kind, geometry, body, legs, gravity, q_mid, qd_mid, M, bias, rho, J, jdqd)
            for i in range(n):  # from the middle of the kept steps back to now
                for a in range(n):
                    rho[i] -= ahead * J[i, a] * qd[a]
            _factor(M, L)
            for a in range(n):
                Q[a] = -bias[a]
            if head[lay.H_MODE_M] > 0.0:
                rider(head, lay.H_MODE_M, own[1], own[0], own[2], qdd, FREEZE * h, mode, Q)
            if head[lay.H_SLOSH_M] > 0.0:
                rider(head, lay.H_SLOSH_M, own[1], own[0], own[2], qdd, FREEZE * h, slosh, Q)
            pushed(head, t, own[1], own[2], Q)
            if head[lay.H_IMU] != 0.0:
                sense(own[0], own[1], own[2], gravity, imu, qdd, sensed)
        for i in range(n):
            _, slope = read_encoder(act, st, i, t)
            decay = math.exp(-act[lay.A_CURRENT_W, i] * h)
            st[lay.S_CURRENT, i] = (
                st[lay.S_FREF, i] + (st[lay.S_CURRENT, i] - st[lay.S_FREF, i]) * decay
            )
            driven = act[lay.A_FORCE_SCALE, i] * slope * st[lay.S_CURRENT, i]
            if act[lay.O_DERATE, i] != 0.0:
                share = abs(st[lay.S_CURRENT, i]) / act[lay.A_FORCE_MAX, i]
                st[lay.S_HEAT, i] += (
                    h / act[lay.O_DERATE_TAU, i] * (4.0 * share - st[lay.S_HEAT, i])
                )
                driven *= 1.0 - act[lay.O_DERATE, i] * min(st[lay.S_HEAT, i], 3.0)
            st[lay.S_TAU, i] = _transmitted(
                act, st, i, st[lay.S_X, i] - rho[i], st[lay.S_V, i] - rate[i]
            )
            force = driven + _resisting(act, st, i, t, h) - st[lay.S_TAU, i]
            past = max(st[lay.S_X, i] - act[lay.A_UPPER, i], 0.0)
            past += min(st[lay.S_X, i] - act[lay.A_LOWER, i], 0.0)
            force -= 3e4 * act[lay.A_MEFF, i] * past
            st[lay.S_V, i] += h * force / act[lay.A_MASS, i]
            st[lay.S_X, i] += h * st[lay.S_V, i]
            st[lay.S_LOAD, i] += (st[lay.S_TAU, i] - st[lay.S_LOAD, i]) * min(1.0, h / 0.003)
        for a in range(n):
            qdd[a] = Q[a]
            for i in range(n):
                qdd[a] += J[i, a] * st[lay.S_TAU, i]
        _back(L, qdd)
        for a in range(n):
            qd[a] += h * qdd[a]
            q[a] += h * qd[a]
        for i in range(n):
            rate[i] = 0.0
            for a in range(n):
                rate[i] += J[i, a] * qd[a]
            rho[i] += h * rate[i]
        if head[lay.H_IMU] != 0.0:
            w = head[lay.H_BANDWIDTH]
            if step == 0:
                for c in range(6):
                    filtered[c] = sensed[c]
            for c in range(6):
                pull = w * w * (sensed[c] - filtered[c]) - math.sqrt(2.0) * w * filter_rate[c]
                filter_rate[c] += h * pull
                filtered[c] += h * filter_rate[c]
        t += h
        step += 1
        if t + h < due:
            continue
        for c in range(rows.shape[1]):
            rows[0, c] = rows[1, c]
        _put(act, st, q, filtered, t, rows[1])
        if not abs(rows[1, 0]) < 1e3:
            return False
        due = np.inf
        for g in range(groups):
            while at[g] < s_first[g + 1] and s_t[at[g]] <= t:
                x = min(max((s_t[at[g]] - t) / h + 1.0, 0.0), 1.0)
                a = rows[0, s_col[g]]
                out[at[g]] = a + (rows[1, s_col[g]] - a) * x
                at[g] += 1
            if at[g] < s_first[g + 1]:
                due = min(due, s_t[at[g]])
    return True
