"""The exam's bicycle in motion: the kernel's mechanism under springs, tyres and a rider of other laws.

Shares with the twin the equations of the four bodies and their contacts, nothing else. Fork: a spring that
stiffens as it goes in, a damper that holds the rebound harder than the compression, a seal that grips. Tyres:
a power of their deflection, as inflated ones have [M]. The rider's back stiffens too, and leans late. Heun's
rule of second order, where the simulated bicycle of `hil.bicycle` takes Runge and Kutta's of fourth.
"""

from __future__ import annotations

import math

import numpy as np

from hil.compiled import compiled, inner
from hil.rigs.bicycle.forward import carry, rider_torques
from hil.rigs.bicycle.kernel import (
    assemble,
    close_loop,
    constraint_rows,
    evaluate,
    factor,
    inertial,
    memory,
    reduce,
    solve,
)

LOCKED = 1e15
SEAL_SPEED = 0.01
"""m/s at which the seal's grip is nearly whole."""
BACK = 0.15
"""rad at which the rider's back is twice as stiff."""


@inner
def fork_force(law, load, u, rate):  # type: ignore[no-untyped-def]
    """N that the fork holds against at travel u (m from rest), rate u'.

    `law`: stiffness at rest, travel over which it doubles, damping in and out, seal.
    """
    side = 1.0 if load >= 0.0 else -1.0
    x, v = side * u, side * rate
    spring = law[0] * x * (1.0 + (x if x > -0.5 * law[1] else -0.5 * law[1]) / law[1])
    damping = law[2] if v > 0.0 else law[3]
    return load + side * (spring + damping * v + law[4] * math.tanh(v / SEAL_SPEED))


@inner
def tyre_force(law, load, u, rate):  # type: ignore[no-untyped-def]
    """N that a tyre holds against; `law`: stiffness under its load at rest, power, damping."""
    size = abs(load)
    side = 1.0 if load >= 0.0 else -1.0
    whole = law[1] * size / law[0]  # deflection at rest
    share = max(1.0 + side * u / whole, 0.0)
    return side * size * share ** law[1] + law[2] * rate


@inner
def accelerate(mem, ws, bicycle, laws, load, torque, q, qd, back, qdd):  # type: ignore[no-untyped-def]
    """Close q, complete qd, fill qdd; returns whether that went, and the rider's angular acceleration.

    `laws`: fork (5,), rear and front tyre (3,), rider (8,) as `carry` wants it. `back`: lean against the
    frame, its rate, the lean that the rider answers.
    """
    p, body, extra, _sensor = bicycle
    fork, rear, front, rider = laws
    M, Q, D, order, N, Mr, Qr, bias, c, dc, contact, rows, order6, pulled = ws
    residual, _ = close_loop(p, q, c, dc, contact)
    if not residual < 1e-9:
        return False, 0.0
    constraint_rows(p, q, 12, False, D)
    if not factor(D, 12, order):
        return False, 0.0
    for i in range(12):
        bias[i] = 0.0
    bias[6], bias[7], bias[8] = qd[3], qd[4], qd[6]
    for k in range(9, 12):
        bias[k] = qd[k]
    solve(D, 12, order, bias)
    for i in range(12):
        qd[i] = bias[i]
    evaluate(mem, p, q, qd)
    assemble(mem, body, extra, qd, 12, M, Q)
    Q[3] += torque[0]
    Q[4] += torque[1]
    Q[5] -= torque[1]
    Q[6] += torque[2]
    if fork[0] < LOCKED:
        Q[9] -= fork_force(fork, load[0], q[9], qd[9])
    Q[10] -= tyre_force(rear, load[1], q[10], qd[10])
    Q[11] -= tyre_force(front, load[2], q[11], qd[11])
    bend = 0.0
    if rider[0] > 0.0:
        a = back[0] + rider[6] * back[2]
        held = rider[4] * a * (1.0 + (a / BACK) ** 2) + rider[5] * back[1]
        bend = carry(rider, extra[0], held, back[0], q, M, Q, pulled)
    reduce(mem, D, order, M, Q, 12, rows, N, Mr, Qr, bias)
    if fork[0] >= LOCKED:
        for s in range(6):
            Mr[3, s] = 0.0
            Mr[s, 3] = 0.0
        Mr[3, 3] = 1.0
        Qr[3] = 0.0
    if not factor(Mr, 6, order6):
        return False, 0.0
    solve(Mr, 6, order6, Qr)
    for i in range(12):
        x = bias[i]
        for r in range(6):
            x += N[i, r] * Qr[r]
        qdd[i] = x
    for i in range(4):
        bend -= pulled[i] * qdd[i]
    return True, bend


@compiled
def memories():  # type: ignore[no-untyped-def]
    """Memory of one ride."""
    return (
        np.zeros((12, 12)),
        np.zeros(12),
        np.zeros((12, 12)),
        np.zeros(12, np.int64),
        np.zeros((12, 6)),
        np.zeros((6, 6)),
        np.zeros(6),
        np.zeros(12),
        np.zeros(2),
        np.zeros((2, 2)),
        np.zeros(3),
        np.array([6, 7, 8, 9, 10, 11]),
        np.zeros(6, np.int64),
        np.zeros(4),
    )


@compiled
def ride_on(bicycle, laws, load, plan, speeds, gains, pushed, slip, dt, out):  # type: ignore[no-untyped-def]
    """Ride from rest; -1, or the step at which it fell.

    `load` (3,): of fork and tyres at rest upright. `plan`, `speeds`, `gains`: as `rider_torques` wants them.
    `pushed` (N,): lean torque from outside, N m. `slip`: share lost, its share that varies, over how many m;
    and the rider's delay, s. Fills `out`: q, qd (N, 12), imu (N, 6).
    """
    p, _body, extra, sensor = bicycle
    q_out, qd_out, imu_out = out
    radius = p[0]
    mem = memory(np.zeros(1))
    ws = memories()
    q, qd, qdd = np.zeros(12), np.zeros(12), np.zeros(12)
    qs, vs, first = np.zeros(12), np.zeros(12), np.zeros(12)
    torque, state, back, back_s = np.zeros(3), np.zeros(2), np.zeros(3), np.zeros(3)
    for t in range(speeds.shape[0]):
        lost = slip[0] * (1.0 + slip[1] * math.sin(q[4] * radius / slip[2]))
        p[2] = radius * (1.0 - lost)
        rider_torques(p, extra, q, qd, plan, dt, state, gains, speeds[t], torque)
        torque[0] += pushed[t]
        ok, bend = accelerate(mem, ws, bicycle, laws, load, torque, q, qd, back, qdd)
        if not ok or not abs(q[3]) <= 1.2:  # nor where it is no number any more
            return t
        for i in range(12):
            q_out[t, i], qd_out[t, i] = q[i], qd[i]
        inertial(mem, extra, p, sensor, qdd, 12, imu_out[t])
        for i in range(12):
            first[i] = qdd[i]
            qs[i] = q[i] + dt * qd[i]
            vs[i] = qd[i] + dt * qdd[i]
        answered = (q[3] - back[2]) / slip[3]
        back_s[0] = back[0] + dt * back[1]
        back_s[1] = back[1] + dt * bend
        back_s[2] = back[2] + dt * answered
        ok, again = accelerate(mem, ws, bicycle, laws, load, torque, qs, vs, back_s, qdd)
        if not ok:
            return t
        for i in range(12):
            q[i] += 0.5 * dt * (qd[i] + vs[i])
            qd[i] += 0.5 * dt * (first[i] + qdd[i])
        back[0] += 0.5 * dt * (back[1] + back_s[1])
        back[1] += 0.5 * dt * (bend + again)
        back[2] = back_s[2]
    return -1
