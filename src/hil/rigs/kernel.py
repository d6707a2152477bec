"""Equations of motion of every rig as compiled code, shared by the model, the plant and the twin.

One scheme serves all kinds. The platform's twist W = (v, omega) of its origin, base axes, follows
from the coordinates by W = A(q) qd. Body and legs give the twist-space equation
M_W Wd + h_W = J_W^T F + constraint wrench; projected on A the constraint vanishes: M = A^T M_W A,
J = J_W A, and M qdd + h = J^T F with rho_dot = J qd. Base frame z up,
R = Rz(yaw) Ry(pitch) Rx(roll).

`geometry`, flat, in m (joint positions: base joints in the base frame, platform joints in the
platform frame), so that any joint can be shifted; `hil.rigs.pack.joint_index` finds a joint:
- AXIS, PENDULUM: [0:3] direction of travel, or of the axis of rotation through the origin.
- MOTORCYCLE: [0:3] leg1.base, [3:6] leg1.platform, [6:9] leg2.base, [9:12] leg2.platform,
  [12:15] slide.base (a point of the slide's line at its zero), [15:18] slide.platform. Cylinder
  axes of the legs and the slide's line stay along j, and the platform origin stays at y = 0 (the
  two cylinders are coupled as mirror images; two C-P-S legs alone would leave four degrees of
  freedom), so that the y of leg1.base and leg2.base moves nothing.
- STEWART: [6 i : 6 i + 3] leg base, [6 i + 3 : 6 i + 6] leg platform, [36] neutral height.

`body` = [m, cx, cy, cz, Ixx, Iyy, Izz, Ixy, Ixz, Iyz]: kg, m, kg m2; elements of the inertia tensor
about the centre of gravity, platform axes. `legs[i]` = [lower_mass, lower_cog, lower_inertia,
upper_mass, upper_cog, upper_inertia] as in the rig file. `gravity`: vector in the base frame, m/s2.

Sources: "Parameters Identification for Motorcycle Simulator's Platform Characterization",
eqs (4)-(28), with the errors of the print mended: platform joint P3 at (-l3, 0, -h3) throughout,
z_m = h - (R p3)_z, angular velocity instead of Euler rates in J, lower right block of the mass
matrix I - m r~ r~, projection instead of the unreduced (27) [V]; "Towards Simulating a Mid-size
Stewart Platform on a Large Hexapod Simulator", eqs (3)-(6), completed by the offset of the centre
of gravity [V].
"""

from __future__ import annotations

import math

import numpy as np

from hil.compiled import compiled, inner
from hil.rigs.bodies import add_at_point, body_terms, leg_terms
from hil.rigs.twist import AXIS, MOTORCYCLE, PENDULUM, STEWART, platform_motion, platform_twist

__all__ = ["AXIS", "MOTORCYCLE", "PENDULUM", "STEWART", "platform_motion", "terms", "twist_terms"]


@inner
def twist_terms(kind, geometry, body, legs, gravity, R, k, Mw, hw, rho, Jw, jw):  # type: ignore[no-untyped-def]
    """M_W Wd + h_W = J_W^T F + constraint wrench; rho; rho_ddot = J_W Wd + j_w, but of an AXIS, which
    only moves along a line (`_along`).

    R and k from `platform_twist`. Fills Mw (6,6), hw (6,), rho (n,), Jw (n,6), jw (n,).
    """
    body_terms(body, gravity, R, k, Mw, hw)
    if kind == PENDULUM:
        for i in range(3):
            Jw[0, i] = 0.0
            Jw[0, 3 + i] = geometry[i]
        jw[0] = 0.0
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
                f = (0.0, legs[i, 3] * (ay - gravity[1]), 0.0)
                along_y = (0.0, legs[i, 3], 0.0)
                add_at_point(0.0, (0.0, 0.0, 0.0), along_y, f, (rx, ry, rz), Mw, hw)
            continue
        planar = kind == MOTORCYCLE
        sx = k[0] + rx - geometry[b]
        sy = 0.0 if planar else k[1] + ry - geometry[b + 1]
        sz = k[2] + rz - geometry[b + 2]
        length = math.sqrt(sx * sx + sy * sy + sz * sz)
        per = 1.0 / length
        nx, ny, nz = sx * per, sy * per, sz * per
        vx = k[3] + wy * rz - wz * ry
        vy = 0.0 if planar else k[4] + wz * rx - wx * rz
        vz = k[5] + wx * ry - wy * rx
        l_dot = nx * vx + ny * vy + nz * vz
        dx, dy, dz = (vx - nx * l_dot) * per, (vy - ny * l_dot) * per, (vz - nz * l_dot) * per
        rho[i] = length
        Jw[i, 0], Jw[i, 1], Jw[i, 2] = nx, ny, nz
        Jw[i, 3], Jw[i, 4], Jw[i, 5] = ry * nz - rz * ny, rz * nx - rx * nz, rx * ny - ry * nx
        jw[i] = nx * ax + ny * ay + nz * az + length * (dx * dx + dy * dy + dz * dz)
        if moving:
            n, n_dot = (nx, ny, nz), (dx, dy, dz)
            bias, r = (ax, ay, az), (rx, ry, rz)
            leg_terms(legs[i], planar, n, length, l_dot, n_dot, bias, r, gravity, Mw, hw)


@inner
def _along(direction, mass, gravity, M, h, J):  # type: ignore[no-untyped-def]
    """M, h and J of a mass that only moves along `direction`."""
    x = direction[0] * direction[0] + direction[1] * direction[1] + direction[2] * direction[2]
    J[0, 0] = x
    M[0, 0] = mass * x
    g = direction[0] * gravity[0] + direction[1] * gravity[1] + direction[2] * gravity[2]
    h[0] = -mass * g


@inner
def _turned(A, k, Mw, hw, Jw, jw, X, M, h, J, jdqd):  # type: ignore[no-untyped-def]
    """The projection on A where it only turns rates into omega, A = blkdiag(1, E), and shifts nothing."""
    for i in range(6):
        for j in range(3):
            X[i, j] = Mw[i, 3] * A[3, 3 + j] + Mw[i, 4] * A[4, 3 + j] + Mw[i, 5] * A[5, 3 + j]
            J[i, j] = Jw[i, j]
            J[i, 3 + j] = Jw[i, 3] * A[3, 3 + j] + Jw[i, 4] * A[4, 3 + j] + Jw[i, 5] * A[5, 3 + j]
        hw[i] += Mw[i, 3] * k[12] + Mw[i, 4] * k[13] + Mw[i, 5] * k[14]
        jdqd[i] = jw[i] + Jw[i, 3] * k[12] + Jw[i, 4] * k[13] + Jw[i, 5] * k[14]
    for i in range(3):
        e0, e1, e2 = A[3, 3 + i], A[4, 3 + i], A[5, 3 + i]
        h[i] = hw[i]
        h[3 + i] = e0 * hw[3] + e1 * hw[4] + e2 * hw[5]
        for j in range(3):
            M[i, j] = Mw[i, j]
            M[i, 3 + j] = X[i, j]
            M[3 + j, i] = X[i, j]
            M[3 + i, 3 + j] = e0 * X[3, j] + e1 * X[4, j] + e2 * X[5, j]


@compiled
def scratch(n):  # type: ignore[no-untyped-def]
    """Memory that `terms_in` works in; afterwards R, A and k of `platform_twist` come first in it."""
    return (
        np.empty((3, 3)),
        np.empty((6, n)),
        np.empty(15),
        np.empty((6, 6)),
        np.empty(6),
        np.empty((n, 6)),
        np.empty(n),
        np.empty((6, n)),
    )


@compiled
def terms(kind, geometry, body, legs, gravity, q, qd, M, h, rho, J, jdqd):  # type: ignore[no-untyped-def]
    """M(q) qdd + h(q, qd) = J^T F, rho(q), rho_dot = J qd, rho_ddot = J qdd + jdqd.

    Inputs as the module says, q, qd (n,) in the rig file's order of coordinates (rad, m). Fills
    M (n,n), h (n,), rho (n,), J (n,n), jdqd (n,): platform and leg masses, WITHOUT reflected rotor
    masses m_r, which add J^T m_r J to M and J^T m_r jdqd to h.
    """
    memory = scratch(q.shape[0])
    terms_in(memory, kind, geometry, body, legs, gravity, q, qd, M, h, rho, J, jdqd)


@inner
def terms_in(memory, kind, geometry, body, legs, gravity, q, qd, M, h, rho, J, jdqd):  # type: ignore[no-untyped-def]
    """As `terms`, in memory that a caller of many steps keeps (`scratch`): allocations cost as much as it."""
    n = q.shape[0]
    R, A, k, Mw, hw, Jw, jw, X = memory
    platform_twist(kind, geometry, q, qd, R, A, k)
    if kind == AXIS:
        # the actuator's moving part travels with the load
        _along(geometry, body[0] + legs[0, 3], gravity, M, h, J)
        rho[0] = q[0]
        jdqd[0] = 0.0
        return
    if kind == PENDULUM:
        rho[0] = q[0]
    twist_terms(kind, geometry, body, legs, gravity, R, k, Mw, hw, rho, Jw, jw)
    if kind == STEWART:
        _turned(A, k, Mw, hw, Jw, jw, X, M, h, J, jdqd)
        return
    for j in range(n):
        a0, a1, a2, a3, a4, a5 = A[0, j], A[1, j], A[2, j], A[3, j], A[4, j], A[5, j]
        for i in range(6):
            x = Mw[i, 0] * a0 + Mw[i, 1] * a1 + Mw[i, 2] * a2
            X[i, j] = x + (Mw[i, 3] * a3 + Mw[i, 4] * a4 + Mw[i, 5] * a5)
        for i in range(n):
            x = Jw[i, 0] * a0 + Jw[i, 1] * a1 + Jw[i, 2] * a2
            J[i, j] = x + (Jw[i, 3] * a3 + Jw[i, 4] * a4 + Jw[i, 5] * a5)
    for i in range(6):
        for c in range(6):
            hw[i] += Mw[i, c] * k[9 + c]
    for i in range(n):
        a0, a1, a2, a3, a4, a5 = A[0, i], A[1, i], A[2, i], A[3, i], A[4, i], A[5, i]
        for j in range(i + 1):
            x = a0 * X[0, j] + a1 * X[1, j] + a2 * X[2, j]
            x += a3 * X[3, j] + a4 * X[4, j] + a5 * X[5, j]
            M[i, j] = x
            M[j, i] = x
        h[i] = a0 * hw[0] + a1 * hw[1] + a2 * hw[2] + (a3 * hw[3] + a4 * hw[4] + a5 * hw[5])
        jdqd[i] = jw[i]
        for c in range(6):
            jdqd[i] += Jw[i, c] * k[9 + c]
