"""What rides on, shakes and senses the platform of the exam's world, beside its actuators.

A mass on springs (the structural mode, or slosh), a base frame that gives way, pushes that nobody told the
rig of, and the inertial sensor. All see the platform through R, A, k of `hil.rigs.twist.platform_twist`.
"""

from __future__ import annotations

import math

import numpy as np

from hil.compiled import compiled, inner
from hil.exam.world import layout as lay


@compiled
def rider(head, at, A, R, k, qdd, h, u, Q):  # type: ignore[no-untyped-def]
    """A mass on springs on the platform: advance it (u: offset, rate, 6) and add what it does to Q (n,)."""
    n = qdd.shape[0]
    m, w, d = head[at], head[at + 1], head[at + 2]
    r = np.empty(3)
    for c in range(3):
        r[c] = R[c, 0] * head[at + 3] + R[c, 1] * head[at + 4] + R[c, 2] * head[at + 5]
    wx, wy, wz = k[6], k[7], k[8]
    w_r = wx * r[0] + wy * r[1] + wz * r[2]
    w_w = wx * wx + wy * wy + wz * wz
    a = np.empty(3)
    a[0] = k[9] + k[13] * r[2] - k[14] * r[1] + wx * w_r - r[0] * w_w
    a[1] = k[10] + k[14] * r[0] - k[12] * r[2] + wy * w_r - r[1] * w_w
    a[2] = k[11] + k[12] * r[1] - k[13] * r[0] + wz * w_r - r[2] * w_w
    P = np.empty((3, n))
    for j in range(n):
        P[0, j] = A[0, j] + A[4, j] * r[2] - A[5, j] * r[1]
        P[1, j] = A[1, j] + A[5, j] * r[0] - A[3, j] * r[2]
        P[2, j] = A[2, j] + A[3, j] * r[1] - A[4, j] * r[0]
        for c in range(3):
            a[c] += P[c, j] * qdd[j]
    for c in range(3):
        pull = -w * w * u[c] - 2.0 * d * w * u[3 + c] - a[c]
        u[3 + c] += h * pull
        u[c] += h * u[3 + c]
        for j in range(n):
            Q[j] -= m * P[c, j] * pull


@inner
def base(head, gravity, qdd, A, k, h, b, out):  # type: ignore[no-untyped-def]
    """A base frame that gives way horizontally: advance b (offset, rate, acceleration filtered; 6)."""
    n = qdd.shape[0]
    w, d = head[lay.H_BASE_W], head[lay.H_BASE_D]
    for c in range(2):
        a = k[9 + c]
        for j in range(n):
            a += A[c, j] * qdd[j]
        pull = -w * w * b[c] - 2.0 * d * w * b[2 + c] - head[lay.H_BASE_RATIO] * a
        b[2 + c] += h * pull
        b[c] += h * b[2 + c]
        b[4 + c] += (pull - b[4 + c]) * min(1.0, 500.0 * h)
        out[c] = gravity[c] - b[4 + c]


@compiled
def pushed(head, t, A, k, Q):  # type: ignore[no-untyped-def]
    """Forces on the platform origin that nobody told the rig of."""
    f = np.zeros(3)
    if head[lay.H_PUSH_F] != 0.0:
        x = head[lay.H_PUSH_F] * math.sin(head[lay.H_PUSH_W] * t + head[lay.H_PUSH_PHASE])
        for c in range(3):
            f[c] += x * head[lay.H_PUSH_X + c]
    if head[lay.H_LOSS_F] != 0.0:
        p = head[lay.H_LOSS_PHASE]
        beat = math.sin(2.0 * math.pi * t / head[lay.H_LOSS_T1] + p)
        beat += math.sin(2.0 * math.pi * t / head[lay.H_LOSS_T2] + 2.0 * p)
        if beat > 0.8:
            f[2] -= head[lay.H_LOSS_F]
    for j in range(Q.shape[0]):
        for c in range(3):
            Q[j] += A[c, j] * f[c]


@compiled
def sense(R, A, k, gravity, imu, qdd, out):  # type: ignore[no-untyped-def]
    """Rate and specific force at the IMU in its own axes into out (6,); imu: place, rotation (3, 9)."""
    n = qdd.shape[0]
    w, a, wd = np.empty(3), np.empty(3), np.empty(3)
    r = np.empty(3)
    for c in range(3):
        w[c], a[c], wd[c] = k[6 + c], k[9 + c] - gravity[c], k[12 + c]
        r[c] = R[c, 0] * imu[0] + R[c, 1] * imu[1] + R[c, 2] * imu[2]
        for j in range(n):
            a[c] += A[c, j] * qdd[j]
            wd[c] += A[3 + c, j] * qdd[j]
    w_r = w[0] * r[0] + w[1] * r[1] + w[2] * r[2]
    w_w = w[0] ** 2 + w[1] ** 2 + w[2] ** 2
    for c in range(3):
        p, q = (c + 1) % 3, (c + 2) % 3
        a[c] += wd[p] * r[q] - wd[q] * r[p] + w[c] * w_r - r[c] * w_w
    for c in range(3):
        out[c] = 0.0
        out[3 + c] = 0.0
        for b in range(3):
            turn = imu[3 + 3 * b + c]
            for e in range(3):
                out[c] += turn * R[e, b] * w[e]
                out[3 + c] += turn * R[e, b] * a[e]
