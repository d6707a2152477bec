"""Equations of motion of every rig as compiled code, shared by the model, the plant and the twin.

One scheme serves all kinds. The platform's twist W = (v, omega) of its origin, base axes, follows
from the coordinates by W = A(q) qd. Body and legs give the twist-space equation M_W Wd + h_W = J_W^T F
(+ constraint wrench); projected on A the constraint vanishes: M = A^T M_W A, J = J_W A, and
M qdd + h = J^T F with rho_dot = J qd. Base frame z up, R = Rz(yaw) Ry(pitch) Rx(roll).

`geometry`, flat, in m (joint positions: base joints in the base frame, platform joints in the
platform frame), so that any joint can be shifted; `hil.rigs.pack.joint_index` finds a joint:
- AXIS, PENDULUM: [0:3] direction of travel, or of the axis of rotation through the origin.
- MOTORCYCLE: [0:3] leg1.base, [3:6] leg1.platform, [6:9] leg2.base, [9:12] leg2.platform,
  [12:15] slide.base (a point of the slide's line at its zero), [15:18] slide.platform. Cylinder axes
  of the legs and the slide's line stay along j, and the platform origin stays at y = 0 (the two
  cylinders are coupled as mirror images; two C-P-S legs alone would leave four degrees of freedom).
- STEWART: [6 i : 6 i + 3] leg base, [6 i + 3 : 6 i + 6] leg platform, [36] neutral height.

`body` = [m, cx, cy, cz, Ixx, Iyy, Izz, Ixy, Ixz, Iyz]: kg, m, kg m2; elements of the inertia tensor
about the centre of gravity, platform axes. `legs[i]` = [lower_mass, lower_cog, lower_inertia,
upper_mass, upper_cog, upper_inertia] as in the rig file. `gravity`: vector in the base frame, m/s2.

Sources: "Parameters Identification for Motorcycle Simulator's Platform Characterization", eqs (4)-(28),
with the errors of the print mended: platform joint P3 at (-l3, 0, -h3) throughout, z_m = h - (R p3)_z,
angular velocity instead of Euler rates in J, lower right block of the mass matrix I - m r~ r~,
projection instead of the unreduced (27) [V]; "Towards Simulating a Mid-size Stewart Platform on a Large
Hexapod Simulator", eqs (3)-(6), completed by the offset of the centre of gravity [V].
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]
compiled: Any = njit(cache=True, nogil=True, error_model="numpy")

AXIS, PENDULUM, MOTORCYCLE, STEWART = 0, 1, 2, 3


@compiled
def rotation_motion(roll, pitch, yaw, rates, E, R, k):  # type: ignore[no-untyped-def]
    """R (3,3); E (3,3): omega = E rates, rates = (roll, pitch, yaw)'; k[6:9] omega, k[12:15] Edot rates."""
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


@compiled
def platform_twist(kind, geometry, q, qd, R, A, k):  # type: ignore[no-untyped-def]
    """Platform kinematics at (q, qd): R (3,3), A (6,n) with W = A qd, and k (15,).

    k = position, velocity, omega, then bias = Adot qd: acceleration and omega_dot at qdd = 0 (each 3).
    """
    A[:, :] = 0.0
    k[:] = 0.0
    if kind == AXIS or kind == PENDULUM:
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
    E = np.empty((3, 3))
    if kind == STEWART:
        rotation_motion(q[3], q[4], q[5], (qd[3], qd[4], qd[5]), E, R, k)
        for i in range(3):
            A[i, i] = 1.0
            k[i] = q[i]
            k[3 + i] = qd[i]
            for j in range(3):
                A[3 + i, 3 + j] = E[i, j]
        k[2] += geometry[36]
        return
    rotation_motion(q[2], q[1], q[0], (qd[2], qd[1], qd[0]), E, R, k)
    x, y, z = geometry[15], geometry[16], geometry[17]
    px = R[0, 0] * x + R[0, 1] * y + R[0, 2] * z  # R p3
    py = R[1, 0] * x + R[1, 1] * y + R[1, 2] * z
    pz = R[2, 0] * x + R[2, 1] * y + R[2, 2] * z
    for j in range(3):  # v = -(omega x R p3), y component held by the coupled cylinders
        ex, ey, ez = E[0, 2 - j], E[1, 2 - j], E[2, 2 - j]
        A[0, j] = -(ey * pz - ez * py)
        A[2, j] = -(ex * py - ey * px)
        A[3, j], A[4, j], A[5, j] = ex, ey, ez
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
def add_at_point(M_P, f, r, Mw, hw):  # type: ignore[no-untyped-def]
    """Add a mass tensor M_P (3,3) and force f (3,) that act at r from the origin to M_W, h_W."""
    rx, ry, rz = r
    X = np.empty((3, 3))  # -M_P r~
    for i in range(3):
        a, b, c = M_P[i, 0], M_P[i, 1], M_P[i, 2]
        X[i, 0], X[i, 1], X[i, 2] = c * ry - b * rz, a * rz - c * rx, b * rx - a * ry
    for i in range(3):
        hw[i] += f[i]
        for j in range(3):
            Mw[i, j] += M_P[i, j]
            Mw[i, 3 + j] += X[i, j]
            Mw[3 + j, i] += X[i, j]
    for j in range(3):  # r~ X
        a, b, c = X[0, j], X[1, j], X[2, j]
        Mw[3, 3 + j] += ry * c - rz * b
        Mw[4, 3 + j] += rz * a - rx * c
        Mw[5, 3 + j] += rx * b - ry * a
    hw[3] += ry * f[2] - rz * f[1]
    hw[4] += rz * f[0] - rx * f[2]
    hw[5] += rx * f[1] - ry * f[0]


@compiled
def body_terms(body, gravity, R, k, Mw, hw):  # type: ignore[no-untyped-def]
    """Newton-Euler of the platform about its origin: fills M_W (6,6) and h_W (6,)."""
    m = body[0]
    c0, c1, c2 = body[1], body[2], body[3]
    rx = R[0, 0] * c0 + R[0, 1] * c1 + R[0, 2] * c2
    ry = R[1, 0] * c0 + R[1, 1] * c1 + R[1, 2] * c2
    rz = R[2, 0] * c0 + R[2, 1] * c1 + R[2, 2] * c2
    for i in range(3):  # inertia about the centre of gravity, base axes: R I R^T
        a, b, c = R[i, 0], R[i, 1], R[i, 2]
        u = a * body[4] + b * body[7] + c * body[8]
        v = a * body[7] + b * body[5] + c * body[9]
        w = a * body[8] + b * body[9] + c * body[6]
        for j in range(3):
            Mw[3 + i, 3 + j] = u * R[j, 0] + v * R[j, 1] + w * R[j, 2]
            Mw[i, j] = 0.0
        Mw[i, i] = m
    wx, wy, wz = k[6], k[7], k[8]
    lx = Mw[3, 3] * wx + Mw[3, 4] * wy + Mw[3, 5] * wz
    ly = Mw[4, 3] * wx + Mw[4, 4] * wy + Mw[4, 5] * wz
    lz = Mw[5, 3] * wx + Mw[5, 4] * wy + Mw[5, 5] * wz
    w_r = wx * rx + wy * ry + wz * rz
    w_w = wx * wx + wy * wy + wz * wz
    fx = m * (wx * w_r - rx * w_w - gravity[0])
    fy = m * (wy * w_r - ry * w_w - gravity[1])
    fz = m * (wz * w_r - rz * w_w - gravity[2])
    hw[0], hw[1], hw[2] = fx, fy, fz
    hw[3] = wy * lz - wz * ly + ry * fz - rz * fy
    hw[4] = wz * lx - wx * lz + rz * fx - rx * fz
    hw[5] = wx * ly - wy * lx + rx * fy - ry * fx
    Mw[0, 3], Mw[0, 4], Mw[0, 5] = 0.0, m * rz, -m * ry  # -m r~
    Mw[1, 3], Mw[1, 4], Mw[1, 5] = -m * rz, 0.0, m * rx
    Mw[2, 3], Mw[2, 4], Mw[2, 5] = m * ry, -m * rx, 0.0
    for i in range(3):
        for j in range(3):
            Mw[3 + j, i] = Mw[i, 3 + j]
    Mw[3, 3] += m * (ry * ry + rz * rz)
    Mw[4, 4] += m * (rx * rx + rz * rz)
    Mw[5, 5] += m * (rx * rx + ry * ry)
    Mw[3, 4] -= m * rx * ry
    Mw[4, 3] -= m * rx * ry
    Mw[3, 5] -= m * rx * rz
    Mw[5, 3] -= m * rx * rz
    Mw[4, 5] -= m * ry * rz
    Mw[5, 4] -= m * ry * rz


@compiled
def leg_terms(leg, planar, n, l, l_dot, n_dot, bias, r, gravity, Mw, hw):  # type: ignore[no-untyped-def]
    """Two-body leg between base joint and platform joint, exact, as a mass at the platform joint.

    With K(l) = m1 c1^2 + I1 + I2 + m2 (l - c2)^2 the leg has T = (m2 l_dot^2 + K |n_dot|^2) / 2, so it
    needs f = M_P a + n m2 c2 |n_dot|^2 + l_dot n_dot (K'/l - 2 K/l^2) + gravity at the joint, with
    M_P = m2 n n^T + K/l^2 (1 - n n^T). A planar leg lies in x-z and slides as a whole along y.
    `bias`: acceleration of the joint at Wdot = 0.
    """
    m1, c1, m2, c2 = leg[0], leg[1], leg[3], leg[4]
    K = m1 * c1 * c1 + leg[2] + leg[5] + m2 * (l - c2) * (l - c2)
    m_t = K / (l * l)
    swing = 2.0 * l_dot * (m2 * (l - c2) - K / l) / l
    w2 = n_dot[0] * n_dot[0] + n_dot[1] * n_dot[1] + n_dot[2] * n_dot[2]
    lift = (m1 * c1 - m2 * c2) / l
    g_n = n[0] * gravity[0] + n[1] * gravity[1] + n[2] * gravity[2]
    M_P = np.empty((3, 3))
    f = np.empty(3)
    for i in range(3):
        for j in range(3):
            M_P[i, j] = (m2 - m_t) * n[i] * n[j]
        M_P[i, i] += m_t
    if planar:
        M_P[1, 1] = m1 + m2
    for i in range(3):
        f[i] = (
            M_P[i, 0] * bias[0]
            + M_P[i, 1] * bias[1]
            + M_P[i, 2] * bias[2]
            + n[i] * m2 * c2 * w2
            + swing * n_dot[i]
            - lift * (gravity[i] - n[i] * g_n)
            - m2 * gravity[i]
        )
    if planar:
        f[1] = (m1 + m2) * (bias[1] - gravity[1])
    add_at_point(M_P, f, r, Mw, hw)


@compiled
def twist_terms(kind, geometry, body, legs, gravity, R, k, Mw, hw, rho, Jw, jw):  # type: ignore[no-untyped-def]
    """M_W Wd + h_W = J_W^T F + constraint wrench; rho; rho_ddot = J_W Wd + j_w.

    R and k from `platform_twist`. Fills Mw (6,6), hw (6,), rho (n,), Jw (n,6), jw (n,).
    """
    body_terms(body, gravity, R, k, Mw, hw)
    if kind == AXIS or kind == PENDULUM:
        first = 0 if kind == AXIS else 3
        for i in range(6):
            Jw[0, i] = geometry[i - first] if first <= i < first + 3 else 0.0
        jw[0] = 0.0
        if kind == AXIS:  # the actuator's moving part travels with the load
            for i in range(3):
                Mw[i, i] += legs[0, 3]
                hw[i] -= legs[0, 3] * gravity[i]
        return
    wx, wy, wz = k[6], k[7], k[8]
    w_w = wx * wx + wy * wy + wz * wz
    for i in range(rho.shape[0]):
        b = 6 * i
        x, y, z = geometry[b + 3], geometry[b + 4], geometry[b + 5]
        rx = R[0, 0] * x + R[0, 1] * y + R[0, 2] * z
        ry = R[1, 0] * x + R[1, 1] * y + R[1, 2] * z
        rz = R[2, 0] * x + R[2, 1] * y + R[2, 2] * z
        w_r = wx * rx + wy * ry + wz * rz
        ax, ay, az = wx * w_r - rx * w_w, wy * w_r - ry * w_w, wz * w_r - rz * w_w
        moving = legs[i, 0] + legs[i, 2] + legs[i, 3] + legs[i, 5] > 0.0
        if kind == MOTORCYCLE and i == 2:  # the slide: a carriage on a line along j
            rho[i] = k[1] + ry - geometry[b + 1]
            Jw[i, 0], Jw[i, 1], Jw[i, 2] = 0.0, 1.0, 0.0
            Jw[i, 3], Jw[i, 4], Jw[i, 5] = -rz, 0.0, rx
            jw[i] = ay
            if moving:
                M_P = np.zeros((3, 3))
                M_P[1, 1] = legs[i, 3]
                f = np.zeros(3)
                f[1] = legs[i, 3] * (ay - gravity[1])
                add_at_point(M_P, f, (rx, ry, rz), Mw, hw)
            continue
        planar = kind == MOTORCYCLE
        sx = k[0] + rx - geometry[b]
        sy = 0.0 if planar else k[1] + ry - geometry[b + 1]
        sz = k[2] + rz - geometry[b + 2]
        l = math.sqrt(sx * sx + sy * sy + sz * sz)
        nx, ny, nz = sx / l, sy / l, sz / l
        vx = k[3] + wy * rz - wz * ry
        vy = 0.0 if planar else k[4] + wz * rx - wx * rz
        vz = k[5] + wx * ry - wy * rx
        l_dot = nx * vx + ny * vy + nz * vz
        dx, dy, dz = (vx - nx * l_dot) / l, (vy - ny * l_dot) / l, (vz - nz * l_dot) / l
        rho[i] = l
        Jw[i, 0], Jw[i, 1], Jw[i, 2] = nx, ny, nz
        Jw[i, 3], Jw[i, 4], Jw[i, 5] = ry * nz - rz * ny, rz * nx - rx * nz, rx * ny - ry * nx
        jw[i] = nx * ax + ny * ay + nz * az + l * (dx * dx + dy * dy + dz * dz)
        if moving:
            leg_terms(
                legs[i], planar, (nx, ny, nz), l, l_dot, (dx, dy, dz), (ax, ay, az), (rx, ry, rz),
                gravity, Mw, hw,
            )  # fmt: skip


@compiled
def terms(kind, geometry, body, legs, gravity, q, qd, M, h, rho, J, jdqd):  # type: ignore[no-untyped-def]
    """M(q) qdd + h(q, qd) = J^T F, rho(q), rho_dot = J qd, rho_ddot = J qdd + jdqd.

    Inputs as the module says, q, qd (n,) in the rig file's order of coordinates (rad, m). Fills
    M (n,n), h (n,), rho (n,), J (n,n), jdqd (n,): platform and leg masses, WITHOUT reflected rotor masses
    m_r, which add J^T m_r J to M and J^T m_r jdqd to h.
    """
    n = q.shape[0]
    R, A, k = np.empty((3, 3)), np.empty((6, n)), np.empty(15)
    Mw, hw, Jw, jw, X = (
        np.empty((6, 6)),
        np.empty(6),
        np.empty((n, 6)),
        np.empty(n),
        np.empty((6, n)),
    )
    platform_twist(kind, geometry, q, qd, R, A, k)
    if kind == AXIS or kind == PENDULUM:
        rho[0] = q[0]
    twist_terms(kind, geometry, body, legs, gravity, R, k, Mw, hw, rho, Jw, jw)
    for i in range(6):
        for j in range(n):
            x = 0.0
            for c in range(6):
                x += Mw[i, c] * A[c, j]
            X[i, j] = x
        for c in range(6):
            hw[i] += Mw[i, c] * k[9 + c]
    for i in range(n):
        for j in range(i + 1):
            x = 0.0
            for c in range(6):
                x += A[c, i] * X[c, j]
            M[i, j] = x
            M[j, i] = x
        x = 0.0
        y = jw[i]
        for c in range(6):
            x += A[c, i] * hw[c]
            y += Jw[i, c] * k[9 + c]
        h[i] = x
        jdqd[i] = y
        for j in range(n):
            x = 0.0
            for c in range(6):
                x += Jw[i, c] * A[c, j]
            J[i, j] = x


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
