"""Actuator forces as a linear function of the platform's ten rigid-body parameters, compiled.

p = [m, m cx, m cy, m cz, Ixx, Iyy, Izz, Ixy, Ixz, Iyz], moments about the platform origin, platform axes.
From Newton-Euler, with a, omega, alpha of the origin and h = R (m c):
f = m (a - g) + alpha x h + omega x (omega x h), n = h x (a - g) + R I R^T alpha + omega x R I R^T omega.
Projected on the coordinates, A^T [f; n] = Y p = (J A)^T F, the constraint forces are gone:
"Parameters Identification for Motorcycle Simulator's Platform Characterization", (28)-(34), mended: its
(34) keeps the multipliers, which are no constants, among the unknowns [V].
"""

from __future__ import annotations

import numpy as np

from hil.compiled import compiled
from hil.rigs.kernel import terms
from hil.rigs.linear import solve_square
from hil.rigs.twist import platform_twist

PARAMETERS = 10
_FIRST = (0, 1, 2, 0, 0, 1)
_SECOND = (0, 1, 2, 1, 2, 2)


@compiled
def twist_regressor(R, k, gravity, wdot, Y):  # type: ignore[no-untyped-def]
    """Fill Y (6, 10): wrench on the platform at its origin = Y p. k, R of `platform_twist`, wdot (6,)."""
    w, al = k[6:9], wdot[3:6]
    b = wdot[:3] - gravity
    Y[:, :] = 0.0
    for i in range(3):
        Y[i, 0] = b[i]
    for c in range(3):  # h = R[:, c]
        h = R[:, c]
        wh = w[0] * h[0] + w[1] * h[1] + w[2] * h[2]
        ww = w[0] * w[0] + w[1] * w[1] + w[2] * w[2]
        for i in range(3):
            j, m = (i + 1) % 3, (i + 2) % 3
            Y[i, 1 + c] = al[j] * h[m] - al[m] * h[j] + w[i] * wh - h[i] * ww
            Y[3 + i, 1 + c] = h[j] * b[m] - h[m] * b[j]
    la, lw, u = np.zeros(3), np.zeros(3), np.zeros(3)
    for i in range(3):
        for j in range(3):
            la[i] += R[j, i] * al[j]
            lw[i] += R[j, i] * w[j]
    for c in range(6):
        x, y = _FIRST[c], _SECOND[c]
        for turn in range(2):  # R E R^T alpha, then omega x R E R^T omega
            v = la if turn == 0 else lw
            u[:] = 0.0
            u[x] = v[y]
            if x != y:
                u[y] = v[x]
            s = R @ u
            for i in range(3):
                j, m = (i + 1) % 3, (i + 2) % 3
                Y[3 + i, 4 + c] += s[i] if turn == 0 else w[j] * s[m] - w[m] * s[j]


@compiled
def force_rows(kind, geometry, legs, gravity, q, rho_dot, rho_ddot, qd, qdd, W, own):  # type: ignore[no-untyped-def]
    """For N instants: qd, qdd (N, n) from the actuators' motion; W (N, n, 10) and own (N, n).

    F = W p + own without friction and rotor masses: `own` is what the legs' masses need. Returns the
    index of the first instant at which the mechanism is singular, else -1.
    """
    n = q.shape[1]
    M, J, B = np.empty((n, n)), np.empty((n, n)), np.empty((n, n))
    h, rho, jdqd, x = np.empty(n), np.empty(n), np.empty(n), np.empty(n)
    R, A, k = np.empty((3, 3)), np.empty((6, n)), np.empty(15)
    wdot, Yw, Y = np.empty(6), np.empty((6, PARAMETERS)), np.empty((n, PARAMETERS))
    nobody = np.zeros(10)
    for t in range(q.shape[0]):
        terms(kind, geometry, nobody, legs, gravity, q[t], qd[t], M, h, rho, J, jdqd)
        B[:, :] = J
        qd[t] = rho_dot[t]
        if not solve_square(B, qd[t]):
            return t
        terms(kind, geometry, nobody, legs, gravity, q[t], qd[t], M, h, rho, J, jdqd)
        B[:, :] = J
        qdd[t] = rho_ddot[t] - jdqd
        solve_square(B, qdd[t])
        platform_twist(kind, geometry, q[t], qd[t], R, A, k)
        for i in range(6):
            wdot[i] = k[9 + i]
            for j in range(n):
                wdot[i] += A[i, j] * qdd[t, j]
        twist_regressor(R, k, gravity, wdot, Yw)
        for a in range(n):
            for c in range(PARAMETERS):
                s = 0.0
                for i in range(6):
                    s += A[i, a] * Yw[i, c]
                Y[a, c] = s
        for c in range(PARAMETERS + 1):
            for a in range(n):
                if c < PARAMETERS:
                    x[a] = Y[a, c]
                else:
                    x[a] = h[a]
                    for j in range(n):
                        x[a] += M[a, j] * qdd[t, j]
                for j in range(n):
                    B[a, j] = J[j, a]
            if not solve_square(B, x):
                return t
            for a in range(n):
                if c < PARAMETERS:
                    W[t, a, c] = x[a]
                else:
                    own[t, a] = x[a]
    return -1
