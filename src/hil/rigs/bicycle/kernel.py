"""Equations of motion and constraints of the bicycle, assembled from `equations.py`; compiled.

q, qd (12,) as in `derivation.py`; the rigid model is the first nine, n = 9. Works in float64 and in
complex128 alike, so that derivatives by complex steps are exact (`linear.py`).

M qdd + J^T lambda = Q with constraints J qd = 0. The rows of D (n, n) are J, then the prescribed
combinations theta, psi (or psi - beta, what an encoder on the frame reads) and gamma, then the
compliances s, d_r, d_f where n = 12. The multipliers of D's rows are minus the forces that act: front
normal force -lambda1, rear tangential (-lambda3, -lambda4), front (-lambda5, -lambda6), lean torque
-lambda7, drive torque -lambda8, steer torque -lambda9.

Source: "Validation of multibody modeling and simulation using an instrumented bicycle: from the computer
to the road", eqs (10)-(31), errors of the print mended: (12) is minus the rates of theta, psi and gamma,
Q_v = L^T (Q_v^ - M^ l qd), (25) is the sum of H^T F, a sensor fixed to the frame reads omega3 and
A3^T (a + g ez) [V]. With the encoder's row psi - beta the drive torque is internal to the bicycle, as
that of pedals is; with psi alone it would act from outside and the load transfer comes out wrong [V].
"""

from __future__ import annotations

import numpy as np

from hil.compiled import compiled, inner
from hil.rigs.bicycle.equations import closure, constraints, kinematics

PSI, BETA, GAMMA, XI = 4, 5, 6, 8


@compiled
def memory(like):  # type: ignore[no-untyped-def]
    """Arrays that `evaluate` fills, of the type of `like`, zeroed."""
    t = like.dtype
    return (
        np.zeros((4, 3, 12), t),
        np.zeros((4, 3), t),
        np.zeros((4, 3, 12), t),
        np.zeros((4, 3), t),
        np.zeros((4, 3), t),
        np.zeros((4, 3), t),
        np.zeros((3, 3), t),
        np.zeros(6, t),
    )


@inner
def evaluate(mem, p, q, qd):  # type: ignore[no-untyped-def]
    """Fill `mem` with the kinematics at q, qd."""
    H, h, G, g, spin, frame, A3, j = mem
    kinematics(p, q, qd, H, h, G, g, spin, frame, A3, j)


@inner
def assemble(mem, body, extra, qd, n, M, Q):  # type: ignore[no-untyped-def]
    """M (n, n) and Q (n,): gravity, drag at body 3, and what velocities cause. After `evaluate`."""
    H, h, G, g, spin, frame, _A3, _j = mem
    for i in range(n):
        Q[i] = 0.0
        for k in range(n):
            M[i, k] = 0.0
    for b in range(4):
        m, ixx, iyy, izz, ixz = body[b, 0], body[b, 1], body[b, 2], body[b, 3], body[b, 4]
        f0, f1, f2 = -m * h[b, 0], -m * h[b, 1], -m * (h[b, 2] + extra[0])
        if b == 1 and extra[1] != 0.0:
            v0, v1, v2 = f0 * 0.0, f0 * 0.0, f0 * 0.0
            for i in range(n):
                v0 += H[1, 0, i] * qd[i]
                v1 += H[1, 1, i] * qd[i]
                v2 += H[1, 2, i] * qd[i]
            speed = np.sqrt(v0 * v0 + v1 * v1 + v2 * v2)
            f0 -= extra[1] * speed * v0
            f1 -= extra[1] * speed * v1
            f2 -= extra[1] * speed * v2
        w0, w1, w2 = spin[b, 0], spin[b, 1], spin[b, 2]
        a0, a1, a2 = frame[b, 0], frame[b, 1], frame[b, 2]
        l0, l1, l2 = ixx * w0 + ixz * w2, iyy * w1, ixz * w0 + izz * w2
        g0, g1, g2 = g[b, 0], g[b, 1], g[b, 2]
        t0 = -(ixx * g0 + ixz * g2 + a1 * l2 - a2 * l1)
        t1 = -(iyy * g1 + a2 * l0 - a0 * l2)
        t2 = -(ixz * g0 + izz * g2 + a0 * l1 - a1 * l0)
        for i in range(n):
            h0, h1, h2 = m * H[b, 0, i], m * H[b, 1, i], m * H[b, 2, i]
            r0, r1, r2 = G[b, 0, i], G[b, 1, i], G[b, 2, i]
            Q[i] += (h0 * f0 + h1 * f1 + h2 * f2) / m + r0 * t0 + r1 * t1 + r2 * t2
            s0, s1, s2 = ixx * r0 + ixz * r2, iyy * r1, ixz * r0 + izz * r2
            for k in range(i + 1):
                M[i, k] += (
                    h0 * H[b, 0, k] + h1 * H[b, 1, k] + h2 * H[b, 2, k]
                    + s0 * G[b, 0, k] + s1 * G[b, 1, k] + s2 * G[b, 2, k]
                )  # fmt: skip
    for i in range(n):
        for k in range(i):
            M[k, i] = M[i, k]


@inner
def constraint_rows(p, q, n, on_frame, D):  # type: ignore[no-untyped-def]
    """D (12, 12), of which (n, n) counts: the constraints' rows at q, then what is prescribed."""
    for i in range(n):
        for k in range(n):
            D[i, k] = 0.0
    constraints(p, q, D)
    D[6, 3] = 1.0
    D[7, PSI] = 1.0
    if on_frame:
        D[7, BETA] = -1.0
    D[8, GAMMA] = 1.0
    for i in range(9, n):
        D[i, i] = 1.0


@inner
def factor(A, n, order):  # type: ignore[no-untyped-def]
    """LU in place with row exchanges; False where singular."""
    for k in range(n):
        best = k
        for i in range(k + 1, n):
            if abs(A[i, k]) > abs(A[best, k]):
                best = i
        if not abs(A[best, k]) > 1e-12:
            return False
        order[k] = best
        if best != k:
            for c in range(n):
                A[k, c], A[best, c] = A[best, c], A[k, c]
        for i in range(k + 1, n):
            f = A[i, k] / A[k, k]
            A[i, k] = f
            if f != 0.0:
                for c in range(k + 1, n):
                    A[i, c] -= f * A[k, c]
    return True


@inner
def solve(A, n, order, b):  # type: ignore[no-untyped-def]
    """b := A^-1 b after `factor`."""
    for k in range(n):
        r = order[k]
        b[k], b[r] = b[r], b[k]
    for k in range(n):  # by columns: sums of products would wait for one another
        x = b[k]
        for i in range(k + 1, n):
            b[i] -= A[i, k] * x
    for k in range(n - 1, -1, -1):
        x = b[k] / A[k, k]
        b[k] = x
        for i in range(k):
            b[i] -= A[i, k] * x


@inner
def solve_transposed(A, n, order, b):  # type: ignore[no-untyped-def]
    """b := A^-T b after `factor`."""
    for k in range(n):
        x = b[k] / A[k, k]
        b[k] = x
        for i in range(k + 1, n):
            b[i] -= A[k, i] * x
    for k in range(n - 1, -1, -1):
        x = b[k]
        for i in range(k):
            b[i] -= A[k, i] * x
    for k in range(n - 1, -1, -1):
        r = order[k]
        b[k], b[r] = b[r], b[k]


@inner
def close_loop(p, q, c, dc, contact):  # type: ignore[no-untyped-def]
    """Set beta and xi so that the front wheel touches the road; residual (m) and Newton steps."""
    residual = 1.0
    for step in range(25):
        closure(p, q, c, dc, contact)
        residual = abs(c[0]) + abs(c[1])
        if residual < 1e-15:
            return residual, step
        det = dc[0, 0] * dc[1, 1] - dc[0, 1] * dc[1, 0]
        if det == 0.0:
            return residual, step
        b = (c[0] * dc[1, 1] - c[1] * dc[0, 1]) / det
        x = (dc[0, 0] * c[1] - dc[1, 0] * c[0]) / det
        q[BETA] -= b
        q[XI] -= x
        if abs(b) + abs(x) < 1e-15:
            return residual, step
    return residual, 25


@compiled
def reduce(mem, D, order, M, Q, n, rows, N, Mr, Qr, bias):  # type: ignore[no-untyped-def]
    """Motion in the independent speeds of D's `rows`: N (n, k), Mr = N^T M N, Qr = N^T (Q - M bias).

    `bias` (n,): accelerations where the independent ones are zero. After `assemble` and `factor`.
    """
    j = mem[7]
    k = rows.shape[0]
    for i in range(n):
        bias[i] = -j[i] if i < 6 else 0.0
    solve(D, n, order, bias)
    load, column = np.zeros(n, D.dtype), np.zeros(n, D.dtype)
    for i in range(n):
        x = Q[i]
        for c in range(n):
            x -= M[i, c] * bias[c]
        load[i] = x
    for r in range(k):
        for i in range(n):
            column[i] = 0.0
        column[rows[r]] = 1.0
        solve(D, n, order, column)
        Qr[r] = Q[0] * 0.0
        for i in range(n):
            N[i, r] = column[i]
            Qr[r] += column[i] * load[i]
        for s in range(r + 1):
            Mr[r, s] = Q[0] * 0.0
        for i in range(n):
            x = Q[0] * 0.0
            for c in range(n):
                x += M[i, c] * column[c]
            for s in range(r + 1):
                Mr[r, s] += N[i, s] * x
        for s in range(r):
            Mr[s, r] = Mr[r, s]


@compiled
def inertial(mem, extra, p, sensor, qdd, n, out):  # type: ignore[no-untyped-def]
    """Rate (rad/s) and specific force (m/s2) in the sensor frame into out (6,). After `evaluate`."""
    H, h, G, g, spin, _frame, A3, _j = mem
    a = np.zeros(3)
    d = np.zeros(3)
    for k in range(3):
        a[k] = h[1, k]
        d[k] = g[1, k]
        for i in range(n):
            a[k] += H[1, k, i] * qdd[i]
            d[k] += G[1, k, i] * qdd[i]
    a[2] += extra[0]
    x, y, z = extra[2] - p[7], extra[3], extra[4] - p[8]
    w0, w1, w2 = spin[1, 0], spin[1, 1], spin[1, 2]
    v0, v1, v2 = w1 * z - w2 * y, w2 * x - w0 * z, w0 * y - w1 * x
    f0 = A3[0, 0] * a[0] + A3[1, 0] * a[1] + A3[2, 0] * a[2]
    f1 = A3[0, 1] * a[0] + A3[1, 1] * a[1] + A3[2, 1] * a[2]
    f2 = A3[0, 2] * a[0] + A3[1, 2] * a[1] + A3[2, 2] * a[2]
    f0 += d[1] * z - d[2] * y + w1 * v2 - w2 * v1
    f1 += d[2] * x - d[0] * z + w2 * v0 - w0 * v2
    f2 += d[0] * y - d[1] * x + w0 * v1 - w1 * v0
    for k in range(3):
        out[k] = sensor[k, 0] * w0 + sensor[k, 1] * w1 + sensor[k, 2] * w2
        out[3 + k] = sensor[k, 0] * f0 + sensor[k, 1] * f1 + sensor[k, 2] * f2


@inner
def rear_normal(mem, body, extra, qd, qdd, n, front):  # type: ignore[no-untyped-def]
    """Normal force at the rear wheel, N: what is left of sum m (a_z + g), front and drag taken off."""
    H, h = mem[0], mem[1]
    total = -front
    for b in range(4):
        a = h[b, 2] + extra[0]
        for i in range(n):
            a += H[b, 2, i] * qdd[i]
        total += body[b, 0] * a
    if extra[1] != 0.0:
        v0, v1, v2 = 0.0, 0.0, 0.0
        for i in range(n):
            v0 += H[1, 0, i] * qd[i]
            v1 += H[1, 1, i] * qd[i]
            v2 += H[1, 2, i] * qd[i]
        total += extra[1] * np.sqrt(v0 * v0 + v1 * v1 + v2 * v2) * v2
    return total
