"""Kinematic simulation and inverse dynamics of a ride from its measured coordinates; compiled.

Positions in the text's scheme: measured coordinates as they are, x, y, yaw and front roll integrated with
constant acceleration over a sample, pitch and contact angle by Newton's method on the contact
constraints; then velocities and accelerations from D, all multipliers from its transpose. One pass.

Where fork or tyres give way, their travel is not measured but moves by its own dynamics under the load of
the ride: N^T (M qdd - Q) = -k u - c u', implicit by the average-acceleration rule (Newmark), so that
stiff springs cost no smaller steps. u counts from where the bicycle rests upright.

Source: "Validation of multibody modeling and simulation using an instrumented bicycle: from the computer
to the road", sections 3.2 and 5 [V]; compliance: "sprung Whipple model" [M].
"""

from __future__ import annotations

import numpy as np

from hil.compiled import compiled
from hil.rigs.bicycle.kernel import (
    assemble,
    close_loop,
    constraint_rows,
    evaluate,
    factor,
    inertial,
    memory,
    rear_normal,
    reduce,
    solve,
    solve_transposed,
)

INTEGRATED = (0, 1, 2, 7)


@compiled
def workspace():  # type: ignore[no-untyped-def]
    """Memory of one simulation: M, Q, D and its order, closure's three, reduction's six."""
    return (
        np.zeros((12, 12)),
        np.zeros(12),
        np.zeros((12, 12)),
        np.zeros(12, np.int64),
        np.zeros(2),
        np.zeros((2, 2)),
        np.zeros(3),
        np.zeros((12, 3)),
        np.zeros((3, 3)),
        np.zeros(3),
        np.zeros(12),
        np.array([9, 10, 11]),
        np.zeros(3, np.int64),
    )


@compiled
def static_load(p, body, extra, on_frame):  # type: ignore[no-untyped-def]
    """Generalised forces (3,), N, with which the bicycle at rest upright loads s, d_r and d_f."""
    q, qd = np.zeros(12), np.zeros(12)
    mem = memory(q)
    M, Q, D, order, c, dc, contact, N, Mr, Qr, bias, rows, _order3 = workspace()
    close_loop(p, q, c, dc, contact)
    evaluate(mem, p, q, qd)
    assemble(mem, body, extra, qd, 12, M, Q)
    constraint_rows(p, q, 12, on_frame, D)
    factor(D, 12, order)
    reduce(mem, D, order, M, Q, 12, rows, N, Mr, Qr, bias)
    return Qr


@compiled
def simulate(bicycle, dt, measured, start, springs, out):  # type: ignore[no-untyped-def]
    """Ride with `measured` coordinates (N, 3) and derivatives; -1, or the sample at which it broke.

    `bicycle`: p, body, extra, sensor, encoder on frame. `start` (4,): x, y, yaw and front roll at the
    first sample. `springs`: stiffness and damping (3,) of s, d_r, d_f; an infinite spring locks. Fills
    `out`: q, qd, qdd (N, 12), lambda (N, 9), imu (N, 6) and (N, 5): normal force rear and front, front
    contact point.
    """
    p, body, extra, sensor, on_frame = bicycle
    mob, mob1, mob2 = measured
    q_out, qd_out, qdd_out, lam_out, imu_out, force_out = out
    spring = springs[0]
    count = mob.shape[0]
    rigid = True
    for k in range(3):
        if spring[k] < 1e15:
            rigid = False
    n = 9 if rigid else 12
    q, qd, qdd = np.zeros(12), np.zeros(12), np.zeros(12)
    mem = memory(q)
    ws = workspace()
    M, Q, D, order, c, dc, contact, _N, _Mr, _Qr, _bias, _rows, _order3 = ws
    b = np.zeros(12)
    u2 = np.zeros(3)
    load = np.zeros(3) if rigid else static_load(p, body, extra, on_frame)
    for k in range(4):
        q[INTEGRATED[k]] = start[k]
    for t in range(count):
        if t > 0:
            for k in range(4):
                i = INTEGRATED[k]
                q[i] += dt * qd[i] + 0.5 * dt * dt * qdd[i]
            if not rigid:
                for k in range(3):
                    q[9 + k] += dt * qd[9 + k] + 0.25 * dt * dt * u2[k]
                    qd[9 + k] += 0.5 * dt * u2[k]
        q[3], q[6] = mob[t, 0], mob[t, 2]
        q[4] = mob[t, 1] + (q[5] if on_frame else 0.0)
        residual, _ = close_loop(p, q, c, dc, contact)
        if not residual < 1e-9:
            return t
        if on_frame:
            q[4] = mob[t, 1] + q[5]
        ok = True
        for again in range(1 if rigid else 2):
            constraint_rows(p, q, n, on_frame, D)
            ok = factor(D, n, order)
            if not ok:
                return t
            for i in range(n):
                b[i] = 0.0
            b[6], b[7], b[8] = mob1[t, 0], mob1[t, 1], mob1[t, 2]
            for k in range(9, n):
                b[k] = qd[k]
            solve(D, n, order, b)
            for i in range(n):
                qd[i] = b[i]
            evaluate(mem, p, q, qd)
            assemble(mem, body, extra, qd, n, M, Q)
            for i in range(6):
                b[i] = -mem[7][i]
            b[6], b[7], b[8] = mob2[t, 0], mob2[t, 1], mob2[t, 2]
            if not rigid and again == 0:
                compliance(mem, ws, b, load, springs, dt, q, qd, u2)
                close_loop(p, q, c, dc, contact)
                if on_frame:
                    q[4] = mob[t, 1] + q[5]
                continue
            for k in range(9, n):
                b[k] = u2[k - 9]
            solve(D, n, order, b)
            for i in range(n):
                qdd[i] = b[i]
        for i in range(n):
            x = Q[i]
            for k in range(n):
                x -= M[i, k] * qdd[k]
            b[i] = x
        solve_transposed(D, n, order, b)
        for i in range(12):
            q_out[t, i], qd_out[t, i], qdd_out[t, i] = q[i], qd[i], qdd[i]
        for i in range(9):
            lam_out[t, i] = b[i]
        inertial(mem, extra, p, sensor, qdd, n, imu_out[t])
        force_out[t, 0] = rear_normal(mem, body, extra, qd, qdd, n, -b[0])
        force_out[t, 1] = -b[0]
        for k in range(3):
            force_out[t, 2 + k] = contact[k]
    return -1


@compiled
def compliance(mem, ws, told, load, springs, dt, q, qd, u2):  # type: ignore[no-untyped-def]
    """One implicit step of fork and tyres: sets u'' and corrects u, u' in q, qd."""
    M, Q, D, order, _c, _dc, _contact, N, Mr, Qr, bias, rows, order3 = ws
    spring, damper = springs
    reduce(mem, D, order, M, Q, 12, rows, N, Mr, Qr, bias)
    for i in range(12):  # prescribed accelerations load the springs too
        bias[i] = told[i] if 6 <= i < 9 else 0.0
    solve(D, 12, order, bias)
    force = np.zeros(3)
    for r in range(3):
        force[r] = Qr[r] - load[r]
    for i in range(12):
        x = 0.0
        for k in range(12):
            x += M[i, k] * bias[k]
        for r in range(3):
            force[r] -= N[i, r] * x
    for r in range(3):
        if spring[r] >= 1e15:
            for s in range(3):
                Mr[r, s] = 0.0
                Mr[s, r] = 0.0
            Mr[r, r] = 1.0
            force[r] = 0.0
        else:
            force[r] -= spring[r] * q[9 + r] + damper[r] * qd[9 + r]
            Mr[r, r] += 0.5 * dt * damper[r] + 0.25 * dt * dt * spring[r]
    factor(Mr, 3, order3)
    solve(Mr, 3, order3, force)
    for r in range(3):
        u2[r] = force[r]
        q[9 + r] += 0.25 * dt * dt * force[r]
        qd[9 + r] += 0.5 * dt * force[r]
