"""A ride that nobody measured: the bicycle with a rider who steers, pedals, brakes and puts a foot down.

Forward dynamics of the twelve coordinates with torques inside the bicycle; fork and tyres with springs,
the tyres on an uneven road; the rider's upper body as a pendulum on the frame, coupled to first order in
its small lean alpha. Fourth-order Runge-Kutta in the independent speeds, constraints closed at each stage.

The rider [R]: follows a path by curvature, leans to hold it, steers into the lean as linear roll dynamics
ask (poles at 3 rad/s), and below walking pace a foot or hand holds the bicycle up.
"""

from __future__ import annotations

import math

import numpy as np

from hil.compiled import compiled, inner
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


@compiled
def workspace():  # type: ignore[no-untyped-def]
    """Memory of one simulation."""
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


@inner
def height(road, spacing, at):  # type: ignore[no-untyped-def]
    """Height of the road, m, and its slope at a distance ridden."""
    last = road.shape[0] - 1
    if last < 1 or at <= 0.0:
        return road[0], 0.0
    k = min(int(at / spacing), last - 1)
    slope = (road[k + 1] - road[k]) / spacing
    return road[k] + slope * (at - k * spacing), slope


@inner
def carry(rider, gravity, held, alpha, q, M, Q, pulled):  # type: ignore[no-untyped-def]
    """Put an upper body that leans by `alpha` against the frame, `held` by so much torque, into M and Q.

    First order in its lean: a pendulum about an axis along the frame, whose pivot goes aside with the rear
    contact, with yaw ahead of it and with lean above it. `rider` as `accelerate` has it. Returns alpha''
    where nothing else accelerates and fills `pulled` (4,): what it has less for each of q[:4] that does.
    """
    m, up, h, inertia = rider[0], rider[1], rider[2], rider[3]
    own = inertia + m * h * h
    across, along = m * h * math.cos(q[3]), m * h * gravity * math.cos(q[3])
    pulled[0], pulled[1] = across * math.sin(q[2]), -across * math.cos(q[2])
    pulled[2], pulled[3] = -across * rider[7], own + m * h * up
    bend = (m * h * gravity * math.sin(q[3]) + along * alpha - held) / own
    for i in range(4):
        Q[i] -= pulled[i] * bend
        for k in range(4):
            M[i, k] -= pulled[i] * pulled[k] / own
    Q[3] += along * alpha
    for i in range(4):
        pulled[i] /= own
    return bend


@inner
def accelerate(mem, ws, bicycle, world, torque, q, qd, alpha, qdd):  # type: ignore[no-untyped-def]
    """Close q, complete qd from its independent speeds, fill qdd; returns alpha''. False where broken.

    `bicycle`: p, body, extra, sensor. `world`: stiffness, damping and static load (3,) of fork and tyres;
    rider (8,): mass, pivot's height above the road, height above it, inertia, stiffness, damping, gain of
    counter-lean, pivot's place ahead of the rear axle; road heights and their spacing. `torque`: lean, drive,
    steer. `alpha`: the rider's lean against the frame and its rate.
    """
    p, body, extra, _sensor = bicycle
    spring, damper, load, rider, road, spacing = world
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
    speed = qd[0] * math.cos(q[2]) + qd[1] * math.sin(q[2])
    ridden = q[4] * p[0]
    for k in range(3):
        z, slope = 0.0, 0.0
        if k > 0:
            z, slope = height(road, spacing, ridden + (p[11] if k == 2 else 0.0))
        if spring[k] < 1e15:
            Q[9 + k] -= (
                load[k] + spring[k] * (q[9 + k] + z) + damper[k] * (qd[9 + k] + slope * speed)
            )
    bend = 0.0
    if rider[0] > 0.0:
        held = rider[4] * (alpha[0] + rider[6] * q[3]) + rider[5] * alpha[1]
        bend = carry(rider, extra[0], held, alpha[0], q, M, Q, pulled)
    reduce(mem, D, order, M, Q, 12, rows, N, Mr, Qr, bias)
    for r in range(3):
        if spring[r] >= 1e15:
            for s in range(6):
                Mr[3 + r, s] = 0.0
                Mr[s, 3 + r] = 0.0
            Mr[3 + r, 3 + r] = 1.0
            Qr[3 + r] = 0.0
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


@inner
def _row_at(place, plan):  # type: ignore[no-untyped-def]
    """The row of `plan` at a place counted in rows: within it, whatever the place, even no number."""
    if not place > 0.0:
        return 0
    return int(min(place, plan.shape[0] - 1.0))


@inner
def rider_torques(p, extra, q, qd, plan, dt, state, gains, asked_speed, out):  # type: ignore[no-untyped-def]
    """Lean (foot), drive and steer torque into `out`. `plan` rows: x, y, heading, curvature by distance.

    `state`: distance along the path, filtered lean reference. `gains`: spacing of the plan (m), of offset
    (1/m2) and heading (1/m), pole of the roll motion (rad/s), steer stiffness (N m/rad) and damping, m R
    (kg m), preview of curvature (s). `asked_speed`: reference speed and acceleration.
    """
    speed = qd[0] * math.cos(q[2]) + qd[1] * math.sin(q[2])
    k = _row_at(state[0] / gains[0], plan)
    px, py, heading, curvature = plan[k, 0], plan[k, 1], plan[k, 2], plan[k, 3]
    seen = _row_at((state[0] + gains[7] * speed) / gains[0], plan)
    aside = -math.sin(heading) * (q[0] - px) + math.cos(heading) * (q[1] - py)
    turned = q[2] - heading
    asked = plan[seen, 3] - gains[1] * aside - gains[2] * math.sin(turned)
    asked = min(max(asked, -0.3), 0.3)
    forward = max(speed, 1.5)
    lean = -math.atan(forward * forward * asked / extra[0])
    state[1] += dt * (lean - state[1]) / 0.25
    cl = p[4]
    base = p[11]
    pull = base / (forward * forward * cl)
    steer = -extra[0] * math.tan(state[1]) * pull
    steer -= (extra[0] + gains[3] * gains[3]) * pull * (q[3] - state[1]) + 1.6 * gains[
        3
    ] * pull * qd[3]
    steer = min(max(steer, -0.6), 0.6)
    out[2] = gains[4] * (steer - q[6]) - gains[5] * qd[6]
    drive = gains[6] * (asked_speed[1] + 2.0 * (asked_speed[0] - speed))
    drive += extra[1] * speed * speed * p[0]
    out[1] = min(max(drive, -120.0), 90.0)
    share = min(max(2.0 - speed, 0.0), 1.0)
    out[0] = -share * (3000.0 * q[3] + 500.0 * qd[3])
    state[0] += dt * max(speed, 0.0) * math.cos(turned) / max(1.0 - curvature * aside, 0.2)


@compiled
def simulate_forward(bicycle, world, plan, speeds, gains, dt, out):  # type: ignore[no-untyped-def]
    """As many steps of `dt` as `speeds` has rows, from rest upright; -1, or the step at which it fell.

    `bicycle`, `world` as in `accelerate`; `plan`, `gains` as in `rider_torques`; `speeds`: reference speed
    and acceleration. Fills `out`, one row a step: q, qd (12), imu (6), torques (4): lean, drive, steer
    torque and the rider's lean.
    """
    p, _body, extra, sensor = bicycle
    q_out, qd_out, imu_out, torque_out = out
    mem = memory(np.zeros(1))
    ws = workspace()
    q, qd, qdd = np.zeros(12), np.zeros(12), np.zeros(12)
    qs, vs = np.zeros(12), np.zeros(12)
    dq, dv = np.zeros(12), np.zeros(12)
    alpha, alpha_s, da = np.zeros(2), np.zeros(2), np.zeros(2)
    torque, state = np.zeros(3), np.zeros(2)
    for t in range(speeds.shape[0]):
        rider_torques(p, extra, q, qd, plan, dt, state, gains, speeds[t], torque)
        for i in range(12):
            dq[i], dv[i], qs[i], vs[i] = 0.0, 0.0, q[i], qd[i]
        da[0], da[1], alpha_s[0], alpha_s[1] = 0.0, 0.0, alpha[0], alpha[1]
        for stage in range(4):
            ok, bend = accelerate(mem, ws, bicycle, world, torque, qs, vs, alpha_s, qdd)
            if not ok or not abs(qs[3]) <= 1.2:  # nor where it is no number any more
                return t
            if stage == 0:
                for i in range(12):
                    q_out[t, i], qd_out[t, i] = qs[i], vs[i]
                inertial(mem, extra, p, sensor, qdd, 12, imu_out[t])
                torque_out[t, 0], torque_out[t, 1], torque_out[t, 2] = (
                    torque[0],
                    torque[1],
                    torque[2],
                )
                torque_out[t, 3] = alpha[0]
            weight = dt / 6.0 if stage in (0, 3) else dt / 3.0
            ahead = dt if stage == 2 else 0.5 * dt
            for i in range(12):
                dq[i] += weight * vs[i]
                dv[i] += weight * qdd[i]
                if stage < 3:
                    qs[i], vs[i] = q[i] + ahead * vs[i], qd[i] + ahead * qdd[i]
            da[0] += weight * alpha_s[1]
            da[1] += weight * bend
            if stage < 3:
                rate = alpha_s[1]
                alpha_s[0], alpha_s[1] = alpha[0] + ahead * rate, alpha[1] + ahead * bend
        for i in range(12):
            q[i] += dq[i]
            qd[i] += dv[i]
        alpha[0] += da[0]
        alpha[1] += da[1]
    return -1
