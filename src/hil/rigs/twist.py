"""How the platform moves with the coordinates: rotation, twist W = A(q) qd and its rate, compiled.

Base frame z up, R = Rz(yaw) Ry(pitch) Rx(roll); twist W = (v, omega) of the platform origin in base
axes. Layout of `geometry` and sources: `hil.rigs.kernel`.
"""

from __future__ import annotations

import math

import numpy as np

from hil.compiled import compiled, inner

AXIS, PENDULUM, MOTORCYCLE, STEWART = 0, 1, 2, 3


@inner
def rotation_motion(roll, pitch, yaw, rates, E, R, k):  # type: ignore[no-untyped-def]
    """Rotation R (3,3) and E (3,3) with omega = E rates, rates = (roll, pitch, yaw)'.

    Also k[6:9] = omega and k[12:15] = Edot rates.
    """
    cr, sr, cp, sp = math.cos(roll), math.sin(roll), math.cos(pitch), math.sin(pitch)
    cy, sy = math.cos(yaw), math.sin(yaw)
    rd, pd, yd = rates
    R[0, 0], R[0, 1], R[0, 2] = cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr
    R[1, 0], R[1, 1], R[1, 2] = sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr
    R[2, 0], R[2, 1], R[2, 2] = -sp, cp * sr, cp * cr
    E[0, 0], E[0, 1], E[0, 2] = cp * cy, -sy, 0.0
    E[1, 0], E[1, 1], E[1, 2] = cp * sy, cy, 0.0
    E[2, 0], E[2, 1], E[2, 2] = -sp, 0.0, 1.0
    for i in range(3):
        k[6 + i] = E[i, 0] * rd + E[i, 1] * pd + E[i, 2] * yd
    k[12] = (-sp * cy * pd - cp * sy * yd) * rd - cy * yd * pd
    k[13] = (-sp * sy * pd + cp * cy * yd) * rd - sy * yd * pd
    k[14] = -cp * pd * rd


@inner
def platform_twist(kind, geometry, q, qd, R, A, k):  # type: ignore[no-untyped-def]
    """Platform kinematics at (q, qd): R (3,3), A (6,n) with W = A qd, and k (15,).

    k = position, velocity, omega, then bias = Adot qd: acceleration, omega_dot at qdd = 0; each 3.
    """
    A[:, :] = 0.0
    k[:] = 0.0
    if kind in (AXIS, PENDULUM):
        for i in range(3):
            for j in range(3):
                R[i, j] = 1.0 if i == j else 0.0
        ax, ay, az = geometry[0], geometry[1], geometry[2]
        if kind == AXIS:
            for i in range(3):
                A[i, 0] = geometry[i]
                k[i] = geometry[i] * q[0]
                k[3 + i] = geometry[i] * qd[0]
            return
        c, s = math.cos(q[0]), math.sin(q[0])
        u = 1.0 - c  # Rodrigues
        R[0, 0], R[0, 1], R[0, 2] = c + ax * ax * u, ax * ay * u - az * s, ax * az * u + ay * s
        R[1, 0], R[1, 1], R[1, 2] = ay * ax * u + az * s, c + ay * ay * u, ay * az * u - ax * s
        R[2, 0], R[2, 1], R[2, 2] = az * ax * u - ay * s, az * ay * u + ax * s, c + az * az * u
        for i in range(3):
            A[3 + i, 0] = geometry[i]
            k[6 + i] = geometry[i] * qd[0]
        return
    if kind == STEWART:
        rotation_motion(q[3], q[4], q[5], (qd[3], qd[4], qd[5]), A[3:, 3:], R, k)
        for i in range(3):
            A[i, i] = 1.0
            k[i] = q[i]
            k[3 + i] = qd[i]
        k[2] += geometry[36]
        return
    rotation_motion(q[2], q[1], q[0], (qd[2], qd[1], qd[0]), A[3:, ::-1], R, k)
    x, y, z = geometry[15], geometry[16], geometry[17]
    px = R[0, 0] * x + R[0, 1] * y + R[0, 2] * z  # R p3
    py = R[1, 0] * x + R[1, 1] * y + R[1, 2] * z
    pz = R[2, 0] * x + R[2, 1] * y + R[2, 2] * z
    for j in range(3):  # v = -(omega x R p3), y component held by the coupled cylinders
        ex, ey, ez = A[3, j], A[4, j], A[5, j]
        A[0, j] = -(ey * pz - ez * py)
        A[2, j] = -(ex * py - ey * px)
    k[0] = geometry[12] - px
    k[2] = geometry[14] - pz
    for i in range(0, 3, 2):
        k[3 + i] = A[i, 0] * qd[0] + A[i, 1] * qd[1] + A[i, 2] * qd[2]
    wx, wy, wz = k[6], k[7], k[8]
    w_p = wx * px + wy * py + wz * pz
    w_w = wx * wx + wy * wy + wz * wz
    k[9] = -(k[13] * pz - k[14] * py + wx * w_p - px * w_w)
    k[11] = -(k[12] * py - k[13] * px + wz * w_p - pz * w_w)


@compiled
def platform_motion(kind, geometry, q, qd, qdd, out):  # type: ignore[no-untyped-def]
    """Motion of the platform origin in the base frame, SI.

    Fills out (24,): R (9, row by row), position, velocity, omega, acceleration, omega_dot (3 each).
    """
    n = q.shape[0]
    R, A, k = np.empty((3, 3)), np.empty((6, n)), np.empty(15)
    platform_twist(kind, geometry, q, qd, R, A, k)
    for i in range(3):
        for j in range(3):
            out[3 * i + j] = R[i, j]
    for i in range(15):
        out[9 + i] = k[i]
    for i in range(6):
        for j in range(n):
            out[18 + i] += A[i, j] * qdd[j]
