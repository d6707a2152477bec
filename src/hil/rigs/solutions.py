"""What one asks of the equations of motion, compiled: forces, accelerations, pose from strokes.

All take a rig's packed arrays in this order: kind, geometry, body, legs, gravity, reflected; layouts
in `hil.rigs.kernel`; reflected (n,): rotor masses at the actuators' outputs. SI throughout.
"""

from __future__ import annotations

import math

import numpy as np

from hil.compiled import compiled
from hil.rigs.kernel import terms, twist_terms
from hil.rigs.linear import solve_positive, solve_square
from hil.rigs.twist import platform_twist


@compiled
def evaluate(kind, geometry, body, legs, gravity, reflected, q, qd):  # type: ignore[no-untyped-def]
    """(M, h, rho, J, jdqd) at (q, qd) as `kernel.terms` says, M and h with rotor masses."""
    n = q.shape[0]
    M, h, rho, J, jdqd = np.empty((n, n)), np.empty(n), np.empty(n), np.empty((n, n)), np.empty(n)
    terms(kind, geometry, body, legs, gravity, q, qd, M, h, rho, J, jdqd)
    for a in range(n):
        if reflected[a] > 0.0:
            for i in range(n):
                x = J[a, i] * reflected[a]
                h[i] += x * jdqd[a]
                for j in range(n):
                    M[i, j] += x * J[a, j]
    return M, h, rho, J, jdqd


@compiled
def inverse_dynamics(  # type: ignore[no-untyped-def]
    kind, geometry, body, legs, gravity, reflected, q, qd, qdd
):
    """(F (n,), found): actuator forces F = J^-T (M qdd + h); found is False where J is singular."""
    M, h, _, J, _ = evaluate(kind, geometry, body, legs, gravity, reflected, q, qd)
    for i in range(q.shape[0]):
        for j in range(q.shape[0]):
            h[i] += M[i, j] * qdd[j]
    return h, solve_square(J.T.copy(), h)


@compiled
def forward_dynamics(  # type: ignore[no-untyped-def]
    kind, geometry, body, legs, gravity, reflected, q, qd, force
):
    """(qdd (n,), found): qdd = M^-1 (J^T F - h); found is False where M is not positive definite."""
    M, h, _, J, _ = evaluate(kind, geometry, body, legs, gravity, reflected, q, qd)
    for i in range(q.shape[0]):
        x = -h[i]
        for a in range(q.shape[0]):
            x += J[a, i] * force[a]
        h[i] = x
    return h, solve_positive(M, h)


@compiled
def forward_kinematics(  # type: ignore[no-untyped-def]
    kind, geometry, body, legs, gravity, rho, q, tolerance, iterations
):
    """Newton's method from the guess q (n,), which becomes the pose; returns (residual, steps taken).

    Steps until max |rho(q) - rho| <= tolerance (m, rad), at most `iterations`; NaN where J is
    singular or a value is NaN. J is that of the coordinates' rates, J_W blkdiag(1, E), without
    which convergence is only linear [V].
    """
    n = q.shape[0]
    M, h, here, J, jdqd = np.empty((n, n)), np.empty(n), np.empty(n), np.empty((n, n)), np.empty(n)
    rest = np.zeros(n)
    step = 0
    while True:
        terms(kind, geometry, body, legs, gravity, q, rest, M, h, here, J, jdqd)
        residual = 0.0
        for i in range(n):
            here[i] = rho[i] - here[i]
            if math.isnan(here[i]):  # max() would lose it, and a lost NaN looks converged
                return np.nan, step
            residual = max(residual, abs(here[i]))
        if not residual > tolerance or step == iterations:
            return residual, step
        if not solve_square(J, here):
            return np.nan, step
        for i in range(n):
            q[i] += here[i]
        step += 1


@compiled
def constraint_wrench(  # type: ignore[no-untyped-def]
    kind, geometry, body, legs, gravity, reflected, q, qd, qdd, force
):
    """J_W^T F - (M_W Wd + h_W) (6,): what is left for the constraints, Phi_W^T lambda.

    "Parameters Identification for Motorcycle Simulator's Platform Characterization", (23) mended [V].
    """
    n = q.shape[0]
    R, A, k = np.empty((3, 3)), np.empty((6, n)), np.empty(15)
    Mw, w, rho, Jw, jw = np.empty((6, 6)), np.empty(6), np.empty(n), np.empty((n, 6)), np.empty(n)
    platform_twist(kind, geometry, q, qd, R, A, k)
    twist_terms(kind, geometry, body, legs, gravity, R, k, Mw, w, rho, Jw, jw)
    Wd = k[9:15].copy()
    for i in range(6):
        for j in range(n):
            Wd[i] += A[i, j] * qdd[j]
    for i in range(6):
        w[i] = -w[i]
        for j in range(6):
            w[i] -= Mw[i, j] * Wd[j]
    for a in range(n):
        rho_ddot = jw[a]
        for j in range(6):
            rho_ddot += Jw[a, j] * Wd[j]
        for i in range(6):
            w[i] += Jw[a, i] * (force[a] - reflected[a] * rho_ddot)
    return w
