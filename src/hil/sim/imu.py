"""The platform's inertial sensor: specific force and rate at the sensor, through its low-pass filter.

Second-order Butterworth filter of the rig file's bandwidth, advanced exactly for inputs that are constant
over a step. Its group delay at low frequency is sqrt(2) / (2 pi bandwidth); the rig file's `imu.delay` says
how much of that is left in the answers.
"""

from __future__ import annotations

import math

import numpy as np

from hil.compiled import compiled
from hil.rigs.kernel import platform_motion


@compiled
def group_delay_s(bandwidth_hz):  # type: ignore[no-untyped-def]
    """Group delay of the filter at low frequency, s."""
    return math.sqrt(2.0) / (2.0 * math.pi * bandwidth_hz)


@compiled
def measure(kind, geometry, gravity, imu, q, qd, qdd, motion, out):  # type: ignore[no-untyped-def]
    """Rate (rad/s) and specific force (m/s^2) in the sensor frame into out (6,); `motion` (24,) scratch.

    f = R^T (a - g), a = a_O + omega' x r + omega x (omega x r), r = R p, p the sensor in the platform frame.
    """
    motion[:] = 0.0
    platform_motion(kind, geometry, q, qd, qdd, motion)
    w0, w1, w2 = motion[15], motion[16], motion[17]
    d0, d1, d2 = motion[21], motion[22], motion[23]
    r = np.empty(3)
    for a in range(3):
        r[a] = motion[3 * a] * imu[0] + motion[3 * a + 1] * imu[1] + motion[3 * a + 2] * imu[2]
    v0, v1, v2 = w1 * r[2] - w2 * r[1], w2 * r[0] - w0 * r[2], w0 * r[1] - w1 * r[0]
    f0 = motion[18] - gravity[0] + d1 * r[2] - d2 * r[1] + w1 * v2 - w2 * v1
    f1 = motion[19] - gravity[1] + d2 * r[0] - d0 * r[2] + w2 * v0 - w0 * v2
    f2 = motion[20] - gravity[2] + d0 * r[1] - d1 * r[0] + w0 * v1 - w1 * v0
    for a in range(3):  # into the platform frame
        r[a] = motion[a] * f0 + motion[3 + a] * f1 + motion[6 + a] * f2
    g0 = motion[0] * w0 + motion[3] * w1 + motion[6] * w2
    g1 = motion[1] * w0 + motion[4] * w1 + motion[7] * w2
    g2 = motion[2] * w0 + motion[5] * w1 + motion[8] * w2
    for a in range(3):  # and the sensor frame
        out[a] = imu[3 + a] * g0 + imu[6 + a] * g1 + imu[9 + a] * g2
        out[3 + a] = imu[3 + a] * r[0] + imu[6 + a] * r[1] + imu[9 + a] * r[2]


@compiled
def filter_coefficients(bandwidth_hz, h, c):  # type: ignore[no-untyped-def]
    """Exact discretisation of x'' + sqrt(2) w x' + w^2 x = w^2 u for a step h into c (4,):
    deviation x - u and x' / w turn by [[c0, c1], [c2, c3]]."""
    w = 2.0 * math.pi * bandwidth_hz
    a = w * h / math.sqrt(2.0)
    decay = math.exp(-a)
    c[0] = decay * (math.cos(a) + math.sin(a))
    c[1] = decay * math.sqrt(2.0) * math.sin(a)
    c[2] = -c[1]
    c[3] = decay * (math.cos(a) - math.sin(a))


@compiled
def filter_step(c, state, u):  # type: ignore[no-untyped-def]
    """Advance the filters (state: six values, then six rates / w) for inputs u (6,)."""
    for a in range(6):
        x, v = state[a] - u[a], state[6 + a]
        state[a] = u[a] + c[0] * x + c[1] * v
        state[6 + a] = c[2] * x + c[3] * v
