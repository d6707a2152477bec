"""What bodies and legs weigh: twist-space mass matrix and bias force of each, compiled."""

from __future__ import annotations

from hil.compiled import inner


@inner
def add_at_point(m_n, n, m, f, r, Mw, hw):  # type: ignore[no-untyped-def]
    """Add the mass tensor m_n n n^T + diag(m) and a force f that act at r from the origin to M_W, h_W; n, m,
    f, r of three numbers each."""
    rx, ry, rz = r
    mx, my, mz = m
    c = (ry * n[2] - rz * n[1], rz * n[0] - rx * n[2], rx * n[1] - ry * n[0])  # r x n
    for i in range(3):
        hw[i] += f[i]
        Mw[i, i] += m[i]
        for j in range(3):
            Mw[i, j] += m_n * n[i] * n[j]
            Mw[i, 3 + j] += m_n * n[i] * c[j]
            Mw[3 + j, i] += m_n * n[i] * c[j]
            Mw[3 + i, 3 + j] += m_n * c[i] * c[j]
    for i, j, x in (  # diag(m) r~^T
        (0, 4, mx * rz), (0, 5, -mx * ry), (1, 3, -my * rz),
        (1, 5, my * rx), (2, 3, mz * ry), (2, 4, -mz * rx),
    ):  # fmt: skip
        Mw[i, j] += x
        Mw[j, i] += x
    Mw[3, 3] += my * rz * rz + mz * ry * ry  # r~ diag(m) r~^T
    Mw[4, 4] += mx * rz * rz + mz * rx * rx
    Mw[5, 5] += mx * ry * ry + my * rx * rx
    for i, j, x in ((3, 4, mz * rx * ry), (3, 5, my * rx * rz), (4, 5, mx * ry * rz)):
        Mw[i, j] -= x
        Mw[j, i] -= x
    hw[3] += ry * f[2] - rz * f[1]
    hw[4] += rz * f[0] - rx * f[2]
    hw[5] += rx * f[1] - ry * f[0]


@inner
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


@inner
def leg_terms(leg, planar, n, length, length_dot, n_dot, bias, r, gravity, Mw, hw):  # type: ignore[no-untyped-def]
    """Two-body leg between base joint and platform joint, exact, as a mass at the platform joint.

    With K(l) = m1 c1^2 + I1 + I2 + m2 (l - c2)^2 the leg of length l along n has
    T = (m2 l_dot^2 + K |n_dot|^2) / 2, so at the joint it needs
    f = M_P a + n m2 c2 |n_dot|^2 + l_dot n_dot (K'/l - 2 K/l^2) + gravity, with
    M_P = m2 n n^T + K/l^2 (1 - n n^T). A planar leg lies in x-z and slides as a whole along y.
    `bias`: acceleration of the joint at Wdot = 0.
    """
    m1, c1, m2, c2 = leg[0], leg[1], leg[3], leg[4]
    K = m1 * c1 * c1 + leg[2] + leg[5] + m2 * (length - c2) * (length - c2)
    m_t = K / (length * length)
    swing = 2.0 * length_dot * (m2 * (length - c2) - K / length) / length
    w2 = n_dot[0] * n_dot[0] + n_dot[1] * n_dot[1] + n_dot[2] * n_dot[2]
    lift = (m1 * c1 - m2 * c2) / length
    g_n = n[0] * gravity[0] + n[1] * gravity[1] + n[2] * gravity[2]
    m_y = m1 + m2 if planar else m_t
    along = (m2 - m_t) * (n[0] * bias[0] + n[1] * bias[1] + n[2] * bias[2])
    along += m2 * c2 * w2 + lift * g_n
    pull = lift + m2
    fx = n[0] * along + m_t * bias[0] + swing * n_dot[0] - pull * gravity[0]
    fy = n[1] * along + m_t * bias[1] + swing * n_dot[1] - pull * gravity[1]
    fz = n[2] * along + m_t * bias[2] + swing * n_dot[2] - pull * gravity[2]
    if planar:
        fy = (m1 + m2) * (bias[1] - gravity[1])
    add_at_point(m2 - m_t, n, (m_t, m_y, m_t), (fx, fy, fz), r, Mw, hw)
