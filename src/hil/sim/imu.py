"""The platform's inertial sensor: specific force and rate there, through its mount and low-pass filter.

A mount that gives lets the sensor swing along its own axes: z'' + 2 d w z' + w^2 z = -f, and the sensor reads
f + z''. It turns no more than the platform does.

Second-order Butterworth filter of the rig file's bandwidth, advanced exactly for inputs that are constant
over a step. Its group delay at low frequency is sqrt(2) / (2 pi bandwidth); the rig file's `imu.delay` says
how much of that is left in the answers.
"""

from __future__ import annotations

import math

from hil.compiled import inner


@inner
def group_delay_s(bandwidth_hz):  # type: ignore[no-untyped-def]
    """Group delay of the filter at low frequency, s."""
    return math.sqrt(2.0) / (2.0 * math.pi * bandwidth_hz)


@inner
def measure(R, A, k, gravity, imu, qd, qdd, out):  # type: ignore[no-untyped-def]
    """Rate (rad/s) and specific force (m/s^2) in the sensor frame into out (6,).

    R, A, k of `rigs.twist.platform_twist`: W = A qd, Wd = A qdd + k[9:15]. f = R^T (a - g) with
    a = a_O + omega' x r + omega x (omega x r), r = R p, p the sensor in the platform frame.
    """
    n = qd.shape[0]
    w0, w1, w2 = 0.0, 0.0, 0.0
    f0, f1, f2 = k[9] - gravity[0], k[10] - gravity[1], k[11] - gravity[2]
    d0, d1, d2 = k[12], k[13], k[14]
    for j in range(n):
        w0 += A[3, j] * qd[j]
        w1 += A[4, j] * qd[j]
        w2 += A[5, j] * qd[j]
        f0 += A[0, j] * qdd[j]
        f1 += A[1, j] * qdd[j]
        f2 += A[2, j] * qdd[j]
        d0 += A[3, j] * qdd[j]
        d1 += A[4, j] * qdd[j]
        d2 += A[5, j] * qdd[j]
    r0 = R[0, 0] * imu[0] + R[0, 1] * imu[1] + R[0, 2] * imu[2]
    r1 = R[1, 0] * imu[0] + R[1, 1] * imu[1] + R[1, 2] * imu[2]
    r2 = R[2, 0] * imu[0] + R[2, 1] * imu[1] + R[2, 2] * imu[2]
    v0, v1, v2 = w1 * r2 - w2 * r1, w2 * r0 - w0 * r2, w0 * r1 - w1 * r0
    f0 += d1 * r2 - d2 * r1 + w1 * v2 - w2 * v1
    f1 += d2 * r0 - d0 * r2 + w2 * v0 - w0 * v2
    f2 += d0 * r1 - d1 * r0 + w0 * v1 - w1 * v0
    for a in range(3):
        out[a] = 0.0
        out[3 + a] = 0.0
    for b in range(3):  # into the platform frame, then the sensor's
        rate = R[0, b] * w0 + R[1, b] * w1 + R[2, b] * w2
        specific = R[0, b] * f0 + R[1, b] * f1 + R[2, b] * f2
        for a in range(3):
            out[a] += imu[3 + 3 * b + a] * rate
            out[3 + a] += imu[3 + 3 * b + a] * specific


@inner
def coefficients(w, damping, h, c):  # type: ignore[no-untyped-def]
    """Exact discretisation of x'' + 2 damping w x' + w^2 x = w^2 u for a step h into c (4,):
    deviation x - u and x' / w turn by [[c0, c1], [c2, c3]]; `damping` below 1."""
    turn = math.sqrt(1.0 - damping * damping)
    a = turn * w * h
    decay = math.exp(-damping * w * h)
    c[0] = decay * (math.cos(a) + damping / turn * math.sin(a))
    c[1] = decay / turn * math.sin(a)
    c[2] = -c[1]
    c[3] = decay * (math.cos(a) - damping / turn * math.sin(a))


@inner
def filter_coefficients(imu, h, c):  # type: ignore[no-untyped-def]
    """Into c (4, 4): `coefficients` of the low-pass filter, then of the mount along each axis."""
    coefficients(2.0 * math.pi * imu[12], math.sqrt(0.5), h, c[0])
    for a in range(3):
        coefficients(2.0 * math.pi * imu[13 + a], imu[16], h, c[1 + a])


@inner
def filter_step(c, imu, state, u):  # type: ignore[no-untyped-def]
    """Advance mount and filters (state: six values, six rates / w, then of the mount three and three) for
    inputs u (6,), which are changed to what the sensor is shaken by."""
    for a in range(3):
        if imu[13 + a] > 0.0:
            x, v, k = state[12 + a] - u[3 + a], state[15 + a], c[1 + a]
            state[12 + a] = u[3 + a] + k[0] * x + k[1] * v
            state[15 + a] = k[2] * x + k[3] * v
            u[3 + a] = state[12 + a] + 2.0 * imu[16] * state[15 + a]
    for a in range(6):
        x, v = state[a] - u[a], state[6 + a]
        state[a] = u[a] + c[0, 0] * x + c[0, 1] * v
        state[6 + a] = c[0, 2] * x + c[0, 3] * v
