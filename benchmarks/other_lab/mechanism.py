"""Geometry and rigid-body dynamics of the three mechanisms, by Jacobians of points and central differences.

Every mass is a point or a body with a Jacobian in the coordinates q: M = sum of J^T m J, and what q' alone
accelerates comes from the Jacobians a moment before and after. Base frame z up, R = Rz(yaw) Ry(pitch)
Rx(roll).
`joints` (n, 2, 3): base joint, platform joint of each actuator. `body`: mass, cog (3), inertia xx yy zz.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

AXIS, MOTORCYCLE, STEWART = 0, 1, 2
MOMENT_S = 2e-4


@njit(cache=True)
def _cross(a, b, out):
    out[0] = a[1] * b[2] - a[2] * b[1]
    out[1] = a[2] * b[0] - a[0] * b[2]
    out[2] = a[0] * b[1] - a[1] * b[0]


@njit(cache=True)
def _rotation(roll, pitch, yaw, R, turn):
    """R and the axes (columns of `turn`) about which roll, pitch and yaw turn."""
    cr, sr, cp, sp = math.cos(roll), math.sin(roll), math.cos(pitch), math.sin(pitch)
    cy, sy = math.cos(yaw), math.sin(yaw)
    R[0, 0], R[0, 1], R[0, 2] = cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr
    R[1, 0], R[1, 1], R[1, 2] = sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr
    R[2, 0], R[2, 1], R[2, 2] = -sp, cp * sr, cp * cr
    turn[0, 0], turn[1, 0], turn[2, 0] = cy * cp, sy * cp, -sp
    turn[0, 1], turn[1, 1], turn[2, 1] = -sy, cy, 0.0
    turn[0, 2], turn[1, 2], turn[2, 2] = 0.0, 0.0, 1.0


@njit(cache=True)
def kinematics(kind, joints, neutral, q, R, A, rho, J, legs, L):
    """R; A (6, n) with (v, omega) = A q'; actuator positions rho; J (n, n) with rho' = J q'.

    `legs` (n, 4): lower mass, its distance from the base joint, upper mass, its distance from the platform
    joint. L (2 n, 3, n): Jacobians of those point masses; filled for the Stewart platform only.
    """
    n = q.shape[0]
    A[:, :] = 0.0
    if kind == AXIS:
        R[:, :] = np.eye(3)
        A[0, 0] = 1.0
        rho[0] = q[0]
        J[0, 0] = 1.0
        return
    turn, origin, arm, vel, cr = (
        np.empty((3, 3)),
        np.zeros(3),
        np.empty(3),
        np.empty(3),
        np.empty(3),
    )
    if kind == STEWART:
        _rotation(q[3], q[4], q[5], R, turn)
        for c in range(3):
            origin[c] = neutral[c] + q[c]
            A[c, c] = 1.0
            for k in range(3):
                A[3 + c, 3 + k] = turn[c, k]
    else:
        _rotation(q[2], q[1], q[0], R, turn)
        rear = R @ joints[2, 1]
        origin[0] = joints[2, 0, 0] - rear[0]
        origin[2] = joints[2, 0, 2] - rear[2]
        for k in range(3):
            for c in range(3):
                A[3 + c, k] = turn[c, 2 - k]
            _cross(A[3:6, k], rear, cr)
            A[0, k] = -cr[0]
            A[2, k] = -cr[2]
    for i in range(n):
        for c in range(3):
            arm[c] = (
                R[c, 0] * joints[i, 1, 0] + R[c, 1] * joints[i, 1, 1] + R[c, 2] * joints[i, 1, 2]
            )
        if kind == MOTORCYCLE and i == 2:
            rho[2] = origin[1] + arm[1] - joints[2, 0, 1]
            for k in range(n):
                _cross(A[3:6, k], arm, cr)
                J[2, k] = A[1, k] + cr[1]
            continue
        sx = origin[0] + arm[0] - joints[i, 0, 0]
        sy = 0.0 if kind == MOTORCYCLE else origin[1] + arm[1] - joints[i, 0, 1]
        sz = origin[2] + arm[2] - joints[i, 0, 2]
        length = math.sqrt(sx * sx + sy * sy + sz * sz)
        nx, ny, nz = sx / length, sy / length, sz / length
        rho[i] = length
        for k in range(n):
            _cross(A[3:6, k], arm, cr)
            for c in range(3):
                vel[c] = A[c, k] + cr[c]
            along = nx * vel[0] + ny * vel[1] + nz * vel[2]
            J[i, k] = along
            if kind == STEWART:
                low, up = legs[i, 1] / length, legs[i, 3] / length
                for c in range(3):
                    across = vel[c] - along * (nx if c == 0 else (ny if c == 1 else nz))
                    L[2 * i, c, k] = low * across
                    L[2 * i + 1, c, k] = vel[c] - up * across


@njit(cache=True)
def invert(M, out):
    """Inverse of a small positive definite matrix; M is spent."""
    n = M.shape[0]
    for a in range(n):
        for b in range(n):
            out[a, b] = 1.0 if a == b else 0.0
    for k in range(n):
        pivot = 1.0 / M[k, k]
        for b in range(n):
            M[k, b] *= pivot
            out[k, b] *= pivot
        for a in range(n):
            if a != k:
                f = M[a, k]
                if f != 0.0:
                    for b in range(n):
                        M[a, b] -= f * M[k, b]
                        out[a, b] -= f * out[k, b]


@njit(cache=True)
def dynamics(
    kind, joints, neutral, body, legs, grav, q, qd, R, A, rho, J, M, bias, drift, Jc, drift_c
):
    """M q'' + bias = J^T tau. Also `drift` (6,): (v', omega') at q'' = 0; Jc (3, n), drift_c (3,): the centre
    of gravity's Jacobian and its acceleration at q'' = 0."""
    n = q.shape[0]
    m = body[0]
    Ap, Am, Rp = np.empty((6, n)), np.empty((6, n)), np.empty((3, 3))
    r1, J1 = np.empty(n), np.empty((n, n))
    massive = kind == STEWART
    size = 2 * n if massive else 0
    L, Lp, Lm = np.zeros((size, 3, n)), np.zeros((size, 3, n)), np.zeros((size, 3, n))
    kinematics(kind, joints, neutral, q + MOMENT_S * qd, Rp, Ap, r1, J1, legs, Lp)
    kinematics(kind, joints, neutral, q - MOMENT_S * qd, Rp, Am, r1, J1, legs, Lm)
    kinematics(kind, joints, neutral, q, R, A, rho, J, legs, L)
    for c in range(6):
        drift[c] = 0.0
        for k in range(n):
            drift[c] += (Ap[c, k] - Am[c, k]) * qd[k] / (2.0 * MOMENT_S)
    if kind == AXIS:
        M[0, 0] = m
        Jc[:, :] = 0.0
        Jc[0, 0] = 1.0
        drift_c[:] = 0.0
        bias[0] = -m * grav[0]
        return
    r = R @ body[1:4]
    inertia = np.zeros((3, 3))
    for a in range(3):
        for b in range(3):
            for c in range(3):
                inertia[a, b] += R[a, c] * body[4 + c] * R[b, c]
    W = A[3:6].copy()
    omega = W @ qd
    cr, cr2 = np.empty(3), np.empty(3)
    for k in range(n):
        _cross(W[:, k].copy(), r, cr)
        for c in range(3):
            Jc[c, k] = A[c, k] + cr[c]
    _cross(omega, r, cr)
    _cross(omega, cr, cr2)
    _cross(drift[3:6], r, cr)
    for c in range(3):
        drift_c[c] = drift[c] + cr[c] + cr2[c]
    _cross(omega, inertia @ omega, cr)
    moment = inertia @ drift[3:6] + cr
    IW = inertia @ W
    for a in range(n):
        bias[a] = 0.0
        for c in range(3):
            bias[a] += m * Jc[c, a] * (drift_c[c] - grav[c]) + W[c, a] * moment[c]
        for b in range(n):
            M[a, b] = 0.0
            for c in range(3):
                M[a, b] += m * Jc[c, a] * Jc[c, b] + W[c, a] * IW[c, b]
    for p in range(size):
        mp = legs[p // 2, 0] if p % 2 == 0 else legs[p // 2, 2]
        if mp == 0.0:
            continue
        for c in range(3):
            acc = -grav[c]
            for k in range(n):
                acc += (Lp[p, c, k] - Lm[p, c, k]) * qd[k] / (2.0 * MOMENT_S)
            for a in range(n):
                bias[a] += mp * L[p, c, a] * acc
                for b in range(n):
                    M[a, b] += mp * L[p, c, a] * L[p, c, b]


@njit(cache=True)
def actuator_positions(kind, joints, neutral, poses, out):
    """Inverse kinematics of poses (k, n) into out (k, n)."""
    n = poses.shape[1]
    R, A, J = np.empty((3, 3)), np.empty((6, n)), np.empty((n, n))
    legs, L = np.zeros((n, 4)), np.zeros((2 * n, 3, n))
    for k in range(poses.shape[0]):
        kinematics(kind, joints, neutral, poses[k], R, A, out[k], J, legs, L)
