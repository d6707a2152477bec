"""One integration step of platform, transmissions and friction, for any kind of rig.

M(q) qdd + h = J^T tau, rho' = J qd: tau_i is the force that actuator i's motor side transmits to the load;
the motor obeys m_r v_m' = F - friction - tau. A rigid transmission ties v_m = (J qd)_i, a compliant one
is a spring and damper on the wind-up e = x_m - rho, backlash a dead band of `gap` in it.

Scheme: leapfrog (drift half a step, kick with M, J, h at the middle, drift half), which is exact for
constant acceleration, second order and free of energy drift for conservative loads; viscous friction
and the hysteresis spring by the trapezoidal rule; the wind-up spring implicit, trapezoidal while it is
soft against the step and implicit Euler as it gets stiff, so that stiffness -> infinity runs smoothly
into the rigid transmission; stick, slip and contact solved exactly at the new velocities. Friction that
has a way to build up, bristles that bend before they slip, is Dahl's instead, by the trapezoidal rule, too;
so is what rubs on the load, behind a transmission that gives.
"""

from __future__ import annotations

import math

import numpy as np

from hil.compiled import compiled, inner
from hil.rigs.kernel import scratch, terms_in
from hil.rigs.linear import solve_square
from hil.sim import layout as lay
from hil.sim.drive_loops import encoder
from hil.sim.friction import (
    GUIDE_M,
    bristle_advance,
    bristle_drag,
    friction_band,
    hysteresis_advance,
    solve_stick_slip,
)

RIGID = 3.0
ALWAYS = 2.0
"""Contact of a transmission: rigid, springy without gap, or at the -1 / +1 flank, or 0 within the gap."""
CONTACT_PASSES = 8
STOP_W = 2.0 * math.pi * 30.0
"""End stops: a mass of `effective_mass` on them swings with 30 Hz, half damped [R]."""

(
    W_LO, W_HI, W_C, W_F0, W_MU, W_PSI, W_KAPPA, W_DINV, W_VA,
    W_ALPHA, W_BETA, W_THETA, W_QD, W_V, W_R, W_PHI, W_X, W_Y, W_STOP_C, W_STOP_F, W_BENT,
) = range(21)  # fmt: skip
WORK_ROWS = 21


@compiled
def memory(n):  # type: ignore[no-untyped-def]
    """What `step` works in, kept by its caller: rows, matrices M J S Y W K, then pose and rates at the middle
    of the step, bias, actuator positions and their bias there, and the kernel's own."""
    matrix = (np.empty((n, n)), np.empty((n, n)), np.empty((n, n)))
    more = (np.empty((n, n)), np.empty((n, n)), np.empty((n, n)))
    vectors = (np.empty(n), np.empty(n), np.empty(n), np.empty(n), np.empty(n))
    return np.empty((WORK_ROWS, n)), matrix, more, vectors, scratch(n)


@inner
def _resist(act, st, w, i, h, force, rho):  # type: ignore[no-untyped-def]
    """Motor-side forces that need no solving: F0 - C v+ ; friction band; end stop on the load."""
    v = st[lay.S_VM, i]
    x = st[lay.S_RHO, i] + st[lay.S_WINDUP, i] + 0.5 * h * v
    _, ratio = encoder(act, i, x)
    f0 = act[lay.A_FORCE_SCALE, i] * ratio * force
    if act[lay.A_RIPPLE_A, i] != 0.0:
        turn = 2.0 * math.pi * (x - act[lay.A_HOME, i]) / act[lay.A_RIPPLE_P, i]
        f0 += act[lay.A_RIPPLE_A, i] * math.sin(turn + act[lay.A_RIPPLE_PHASE, i])
    way = 0.0 if v == 0.0 else math.copysign(1.0, v)
    c = 0.5 * (act[lay.A_VISCOUS, i] + way * act[lay.A_VISCOUS_SKEW, i])
    if act[lay.A_HYST_F, i] != 0.0:
        z = st[lay.S_HYST, i]
        c += 0.25 * h * act[lay.A_HYST_F, i] / act[lay.A_HYST_X, i] * (1.0 - z * way)
        f0 -= act[lay.A_HYST_F, i] * z
    w[W_LO, i], w[W_HI, i] = friction_band(act, st, i)
    w[W_BENT, i] = 0.0
    if act[lay.A_PRESLIDING, i] > 0.0 and st[lay.S_BRAKE, i] == 0.0:
        bent = st[lay.S_BRISTLE, i]
        c += bristle_drag(bent, w[W_LO, i], w[W_HI, i], v, h, act[lay.A_PRESLIDING, i])
        f0 -= bent
        w[W_BENT, i] = -bent
        w[W_LO, i] = 0.0
        w[W_HI, i] = 0.0
    w[W_C, i] = c
    w[W_F0, i] = f0 - c * v + act[lay.A_REFLECTED, i] * st[lay.S_PULL, i]
    past = max(rho - act[lay.A_UPPER, i], 0.0) + min(rho - act[lay.A_LOWER, i], 0.0)
    w[W_STOP_C, i] = 0.0
    w[W_STOP_F, i] = 0.0
    if past != 0.0:
        k = act[lay.A_MEFF, i] * STOP_W**2
        w[W_STOP_C, i] = 0.5 * h * k
        w[W_STOP_F, i] = -k * past
        if past * st[lay.S_RATE, i] > 0.0:
            w[W_STOP_C, i] += act[lay.A_MEFF, i] * STOP_W
    rubs = act[lay.A_GUIDE, i]
    if rubs > 0.0:
        rate, bent = st[lay.S_RATE, i], st[lay.S_GUIDE, i]
        drag = bristle_drag(bent, rubs, rubs, rate, h, GUIDE_M)
        w[W_STOP_C, i] += drag
        w[W_STOP_F, i] -= bent + drag * rate


@inner
def _pull(st, w, bias, M, J, S):  # type: ignore[no-untyped-def]
    """Take from `bias` what accelerates the load as S_PULL asks: like weight it acts on all masses alike, so
    that it swings no spring."""
    n = S.shape[0]
    x = w[W_X]
    for i in range(n):
        x[i] = st[lay.S_PULL, i]
        for a in range(n):
            S[i, a] = J[i, a]
    if solve_square(S, x):
        for a in range(n):
            for b in range(n):
                bias[a] -= M[a, b] * x[b]


@inner
def _couple(act, st, w, i, h):  # type: ignore[no-untyped-def]
    """How motor i reaches the load in this step: added mass MU and impulse PSI seen there, share KAPPA."""
    m = act[lay.A_REFLECTED, i]
    c = w[W_C, i]
    push = m * st[lay.S_VM, i] + h * w[W_F0, i]
    contact = st[lay.S_CONTACT, i]
    if contact == RIGID:
        w[W_KAPPA, i] = 1.0
        w[W_DINV, i] = 0.0
        w[W_VA, i] = 0.0
        w[W_MU, i] = m + h * c
        w[W_PSI, i] = push
    else:
        m = max(m, 1e-3 * act[lay.A_MEFF, i])
        push = m * st[lay.S_VM, i] + h * w[W_F0, i]
        alpha, beta, theta = 0.0, 0.0, 0.5
        if contact != 0.0:
            load = max(act[lay.A_MEFF, i] - m, 0.1 * act[lay.A_MEFF, i])
            inverse = 1.0 / m + 1.0 / load
            k, d, hard = act[lay.A_STIFFNESS, i], act[lay.A_DAMPING, i], act[lay.A_HARDENING, i]
            if k == math.inf:  # flank of a rigid transmission: meets it without bounce
                k, d = 1e6 / (inverse * h * h), 0.0
            u = st[lay.S_VM, i] - st[lay.S_RATE, i]
            e = st[lay.S_WINDUP, i]
            if contact != ALWAYS:
                e -= 0.5 * contact * act[lay.A_GAP, i]
            spring = k * e * (1.0 + hard * e * e)
            k *= 1.0 + 3.0 * hard * e * e
            stiff = 0.25 * inverse * (k * h * h + d * h)
            theta = 0.5 + 0.5 * stiff / (1.0 + stiff)
            alpha = spring + theta * (1.0 - theta) * h * k * u + (1.0 - theta) * d * u
            beta = theta * theta * k * h + theta * d
        D = m + h * (c + beta)
        w[W_ALPHA, i], w[W_BETA, i], w[W_THETA, i] = alpha, beta, theta
        kappa = h * beta / D
        w[W_KAPPA, i] = kappa
        w[W_DINV, i] = 1.0 / D
        w[W_VA, i] = (push - h * alpha) / D
        w[W_MU, i] = kappa * (m + h * c)
        w[W_PSI, i] = kappa * push + (1.0 - kappa) * h * alpha
    w[W_MU, i] += h * w[W_STOP_C, i]
    w[W_PSI, i] += h * w[W_STOP_F, i]


@inner
def _factor(M, J, w, S):  # type: ignore[no-untyped-def]
    """Lower Cholesky factor of M + J^T diag(MU) J in S, on its diagonal the reciprocals."""
    n = S.shape[0]
    for a in range(n):
        for b in range(a + 1):
            s = M[a, b]
            for i in range(n):
                s += w[W_MU, i] * J[i, a] * J[i, b]
            for k in range(b):
                s -= S[a, k] * S[b, k]
            S[a, b] = s * S[b, b] if b < a else 1.0 / math.sqrt(s)


@inner
def _velocities(st, w, bias, M, J, S, h):  # type: ignore[no-untyped-def]
    """New qd, actuator rates R and motor velocities V for friction PHI."""
    n = S.shape[0]
    x = w[W_X]
    for a in range(n):
        s = -h * bias[a]
        for b in range(n):
            s += M[a, b] * st[lay.S_QD, b]
            s += J[b, a] * (w[W_PSI, b] + h * w[W_KAPPA, b] * w[W_PHI, b])
        for k in range(a):
            s -= S[a, k] * x[k]
        x[a] = s * S[a, a]
    for a in range(n - 1, -1, -1):
        s = x[a]
        for k in range(a + 1, n):
            s -= S[k, a] * w[W_QD, k]
        w[W_QD, a] = s * S[a, a]
    for i in range(n):
        r = 0.0
        for a in range(n):
            r += J[i, a] * w[W_QD, a]
        w[W_R, i] = r
        free = w[W_VA, i] + h * w[W_DINV, i] * w[W_PHI, i]
        w[W_V, i] = free + w[W_KAPPA, i] * r


@inner
def _solve(st, w, bias, M, J, S, Y, W, K, h):  # type: ignore[no-untyped-def]
    """Friction forces and new velocities for the present contacts."""
    n = S.shape[0]
    _factor(M, J, w, S)
    slipping = True
    for i in range(n):
        if w[W_LO, i] + w[W_HI, i] == 0.0:
            w[W_PHI, i] = 0.0
        elif st[lay.S_SLIP, i] == 0.0:
            slipping = False
        else:
            w[W_PHI, i] = -w[W_HI, i] if st[lay.S_SLIP, i] > 0.0 else w[W_LO, i]
    if slipping:  # as in the last step, most likely
        _velocities(st, w, bias, M, J, S, h)
        for i in range(n):
            if w[W_V, i] * st[lay.S_SLIP, i] < 0.0 and w[W_LO, i] + w[W_HI, i] > 0.0:
                slipping = False
        if slipping:
            return
    for i in range(n):
        w[W_PHI, i] = 0.0
    _velocities(st, w, bias, M, J, S, h)
    for i in range(n):  # Y = S^-1 J^T, column i
        for a in range(n):
            s = J[i, a]
            for k in range(a):
                s -= S[a, k] * Y[k, i]
            Y[a, i] = s * S[a, a]
    for i in range(n):
        for j in range(i + 1):
            s = 0.0
            for k in range(n):
                s += Y[k, i] * Y[k, j]
            s *= h * w[W_KAPPA, i] * w[W_KAPPA, j]
            W[i, j] = s
            W[j, i] = s
        W[i, i] += h * w[W_DINV, i]
    solve_stick_slip(W, w[W_V], w[W_LO], w[W_HI], st[lay.S_SLIP], w[W_PHI], K, w[W_Y])
    _velocities(st, w, bias, M, J, S, h)
    held = True
    for i in range(n):
        if st[lay.S_SLIP, i] == 0.0:  # exactly, not to rounding
            w[W_V, i] = 0.0
            if st[lay.S_CONTACT, i] == RIGID:
                w[W_R, i] = 0.0
        held = held and st[lay.S_SLIP, i] == 0.0 and st[lay.S_CONTACT, i] == RIGID
    if held:
        for a in range(n):
            w[W_QD, a] = 0.0


@inner
def _contacts(act, st, w, h):  # type: ignore[no-untyped-def]
    """Touch and release flanks where the solution asks for it; True if any contact changed."""
    changed = False
    for i in range(st.shape[1]):
        contact = st[lay.S_CONTACT, i]
        if contact > 1.5:
            continue
        u = w[W_V, i] - w[W_R, i]
        if contact != 0.0:
            if (w[W_ALPHA, i] + w[W_BETA, i] * u) * contact < 0.0:
                st[lay.S_CONTACT, i] = 0.0
                changed = True
        else:
            before = st[lay.S_VM, i] - st[lay.S_RATE, i]
            e = st[lay.S_WINDUP, i] + 0.5 * h * (u + before)
            if abs(e) > 0.5 * act[lay.A_GAP, i]:
                st[lay.S_CONTACT, i] = math.copysign(1.0, e)
                changed = True
    return changed


@inner
def step(kind, views, st, mem, force, h):  # type: ignore[no-untyped-def]
    """Advance the mechanics by h; `force` (n,) is the mean over h of the force by the drives' currents.

    `views` of the model as `model.split` gives them, `mem` from `memory`.
    """
    n = st.shape[1]
    act, geometry, _, body, _, gravity, _, legs, _, _ = views
    w, (M, J, S), (Y, W, K), (q, qd, bias, rho, jdqd), own = mem
    for a in range(n):
        q[a] = st[lay.S_Q, a] + 0.5 * h * st[lay.S_QD, a]
        qd[a] = st[lay.S_QD, a] + 0.5 * h * st[lay.S_QDD, a]
    terms_in(own, kind, geometry, body, legs, gravity, q, qd, M, bias, rho, J, jdqd)
    pulled = False
    for i in range(n):
        _resist(act, st, w, i, h, force[i], rho[i])
        pulled = pulled or st[lay.S_PULL, i] != 0.0
    if pulled:
        _pull(st, w, bias, M, J, S)
    for _ in range(CONTACT_PASSES):
        for i in range(n):
            _couple(act, st, w, i, h)
        _solve(st, w, bias, M, J, S, Y, W, K, h)
        if not _contacts(act, st, w, h):
            break
    per_h = 1.0 / h
    for i in range(n):
        v, r = w[W_V, i], w[W_R, i]
        v_old = st[lay.S_VM, i]
        resist = w[W_F0, i] - w[W_C, i] * v + w[W_PHI, i]
        st[lay.S_LOAD, i] = resist - act[lay.A_REFLECTED, i] * (v - v_old) * per_h
        if st[lay.S_CONTACT, i] != RIGID:
            theta = w[W_THETA, i]
            u_old = v_old - st[lay.S_RATE, i]
            st[lay.S_WINDUP, i] += h * (theta * (v - r) + (1.0 - theta) * u_old)
            st[lay.S_LOAD, i] = w[W_ALPHA, i] + w[W_BETA, i] * (v - r)
        if act[lay.A_HYST_F, i] != 0.0:
            travel = 0.5 * h * (v + v_old)
            st[lay.S_HYST, i] = hysteresis_advance(st[lay.S_HYST, i], travel, act[lay.A_HYST_X, i])
        if act[lay.A_PRESLIDING, i] > 0.0 and st[lay.S_BRAKE, i] == 0.0:
            travel = 0.5 * h * (v + v_old)
            lo, hi = friction_band(act, st, i)
            st[lay.S_BRISTLE, i] = bristle_advance(
                st[lay.S_BRISTLE, i], lo, hi, travel, act[lay.A_PRESLIDING, i]
            )
        rubs = act[lay.A_GUIDE, i]
        if rubs > 0.0:
            travel = 0.5 * h * (r + st[lay.S_RATE, i])
            st[lay.S_GUIDE, i] = bristle_advance(st[lay.S_GUIDE, i], rubs, rubs, travel, GUIDE_M)
        st[lay.S_FRICTION, i] = w[W_PHI, i] + w[W_BENT, i]
        st[lay.S_VM, i] = v
        st[lay.S_RATE, i] = r
        st[lay.S_RHO, i] = rho[i] + 0.5 * h * r + 0.125 * h * h * jdqd[i]
    for a in range(n):
        st[lay.S_QDD, a] = (w[W_QD, a] - st[lay.S_QD, a]) * per_h
        st[lay.S_QD, a] = w[W_QD, a]
        st[lay.S_Q, a] = q[a] + 0.5 * h * w[W_QD, a]
