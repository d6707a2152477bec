"""The rig in time, compiled: drives, elastic transmissions, friction, platform, floor.

Each motor is a mass of its own behind a stiff spring; semi-implicit Euler in steps of a few hundredths of
a millisecond, friction that grows steeply with speed taken implicitly. The platform's matrices are renewed at
every tick of the speed loop. Ticks are those of the drives' own clock, whose phase and rate nobody knows.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from benchmarks.other_lab import layout as lay
from benchmarks.other_lab.friction import bouc_wen, bound, presliding
from benchmarks.other_lab.mechanism import dynamics, invert

BRAKE_WAIT_S = 0.25
BRAKE_SPEED = 1.5e-3
BRAKE_WAY = 2.5e-3
"""A sticking brake bites after so long below so small a speed and lets go after so long a way."""
BEARING_BALLS = 3.57
THROTTLE_TAU_S = 1.2
BANG_S = 2e-3


@njit(cache=True)
def _encoder(act, i, x):
    """(reading, its slope) of the motor encoder where the motor stands at x."""
    home = act[lay.HOME, i]
    reading = home + act[lay.OFFSET, i] + (x - home) / act[lay.LEAD, i]
    slope = 1.0 / act[lay.LEAD, i]
    if act[lay.LEAD_A, i] != 0.0:
        w = 2.0 * math.pi / act[lay.LEAD_P, i]
        angle = w * (x - home) + act[lay.LEAD_PH, i]
        reading -= act[lay.LEAD_A, i] * math.sin(angle)
        slope -= act[lay.LEAD_A, i] * w * math.cos(angle)
    return reading, slope


@njit(cache=True)
def _extra_force(act, i, x, v, t):
    """Ripple and bearing defect: forces on the motor that depend on where it stands."""
    force = 0.0
    if act[lay.RIP_A, i] != 0.0:
        angle = 2.0 * math.pi * (x - act[lay.HOME, i]) / act[lay.RIP_P, i] + act[lay.RIP_PH, i]
        force += act[lay.RIP_A, i] * math.sin(angle)
    if act[lay.BEAR_A, i] != 0.0:
        turns = BEARING_BALLS * x / act[lay.BEAR_P, i] + 0.4 * math.sin(0.9 * t)
        apart = turns - math.floor(turns) - 0.5
        force -= act[lay.BEAR_A, i] * math.exp(-((apart / 0.06) ** 2)) * math.tanh(v / 2e-3)
    return force


@njit(cache=True)
def _cable(act, i, x, v):
    """Force of a cable that drags from CAB_X on."""
    past = x - act[lay.CAB_X, i]
    if act[lay.CAB_F, i] == 0.0 or past <= 0.0:
        return 0.0
    full = min(past / 0.02, 1.0)
    return act[lay.CAB_F, i] * full * (math.tanh(v / 1e-3) + act[lay.CAB_K, i] * past)


@njit(cache=True)
def simulate(
    kind, joints, neutral, body, legs, grav, act, glob, imu_r, events, bangs, q0, hold, until
):
    """Run from rest at pose q0 with drives that hold `hold`; returns (K, 3 n + 6) a tick.

    events (N, 3): arrival s, actuator, setpoint; bangs (B, 3): instant s, actuator, jump m; both in order.
    Columns: encoder reading, force of the current, coordinate of each actuator; gyro and specific force.
    """
    n = q0.shape[0]
    dt, substeps, cycle = glob[lay.TICK], int(glob[lay.SUBSTEPS]), glob[lay.CYCLE]
    h = dt / substeps
    ticks = int((until - glob[lay.START]) / dt) + 1
    out = np.empty((ticks, 3 * n + 6))
    R, A, J, M = np.empty((3, 3)), np.empty((6, n)), np.empty((n, n)), np.empty((n, n))
    Mi, bias, drift = np.empty((n, n)), np.empty(n), np.empty(6)
    Jc, drift_c, rho = np.empty((3, n)), np.empty(3), np.empty(n)
    q, qd, qdd, mean = q0.copy(), np.zeros(n), np.zeros(n), np.zeros(n)
    dynamics(
        kind, joints, neutral, body, legs, grav, q, qd, R, A, rho, J, M, bias, drift, Jc, drift_c
    )
    static = np.linalg.solve(J.T.copy(), bias - glob[lay.SIDE_M] * (Jc.T @ grav))
    xm, vm, z, hz = rho + static / act[lay.KT], np.zeros(n), np.zeros((n, 4)), np.zeros(n)
    for i in range(n):  # a motor with play rests on the flank that carries the load
        if act[lay.GAP, i] != 0.0:
            xm[i] += 0.5 * act[lay.GAP, i] * min(max(static[i], -1.0), 1.0)
    current, current_rate = static / act[lay.KF], np.zeros(n)
    integral, f_ref, v_ref = current.copy(), current.copy(), np.zeros(n)
    x_from, x_to, t_from = hold.copy(), hold.copy(), np.full(n, -1e9)
    waiting, pending = np.zeros(n), np.zeros(n)
    x_seen, x_last, v_seen, tau, carried = (
        np.empty(n),
        np.empty(n),
        np.zeros(n),
        static.copy(),
        static.copy(),
    )
    rate, jump, jump_to = np.zeros(n), np.zeros(n), np.zeros(n)
    heat, slow, calm, stopped, bite = np.zeros(n), np.zeros(n), np.zeros(n), xm.copy(), np.zeros(n)
    notch = np.zeros((n, 4))
    side, side_v, floor, floor_v, floor_a = (
        np.zeros(3),
        np.zeros(3),
        np.zeros(3),
        np.zeros(3),
        np.zeros(3),
    )
    pull, a_c, push = np.zeros(3), np.zeros(3), np.zeros(n)
    for i in range(n):
        x_seen[i], _ = _encoder(act, i, xm[i])
        for k in range(2):
            notch[i, k] = current[i]
            notch[i, 2 + k] = current[i]
    e_at, b_at = 0, 0
    for k in range(ticks):
        t = glob[lay.START] + k * dt
        while e_at < events.shape[0] and events[e_at, 0] <= t:
            pending[int(events[e_at, 1])] = events[e_at, 2]
            waiting[int(events[e_at, 1])] = 1.0
            e_at += 1
        while b_at < bangs.shape[0] and bangs[b_at, 0] <= t:
            jump_to[int(bangs[b_at, 1])] += bangs[b_at, 2]
            b_at += 1
        for i in range(n):
            if (k + int(act[lay.TICK_AT, i])) % lay.POSITION_TICKS == 0:
                share = min((t - t_from[i]) / cycle, 1.0)
                x_ref = x_from[i] + share * (x_to[i] - x_from[i])
                if waiting[i] != 0.0:
                    x_from[i], x_to[i], t_from[i], waiting[i] = x_ref, pending[i], t, 0.0
                v = act[lay.KP, i] * (x_ref - x_seen[i])
                v_ref[i] = min(max(v, -act[lay.VMAX, i]), act[lay.VMAX, i])
            limit = act[lay.FMAX, i]
            error = v_ref[i] - v_seen[i]
            asked = act[lay.KV, i] * error + integral[i]
            given = min(max(asked, -limit), limit)
            if given == asked or (asked - given) * error < 0.0:
                integral[i] += act[lay.KI, i] * error * dt
            smooth = (
                act[lay.NB0, i] * given
                + act[lay.NB1, i] * notch[i, 0]
                + act[lay.NB2, i] * notch[i, 1]
            )
            smooth -= act[lay.NA1, i] * notch[i, 2] + act[lay.NA2, i] * notch[i, 3]
            notch[i, 1], notch[i, 0], notch[i, 3], notch[i, 2] = (
                notch[i, 0],
                given,
                notch[i, 2],
                smooth,
            )
            heat[i] += dt / THROTTLE_TAU_S * (smooth * smooth - heat[i])
            if heat[i] > act[lay.THR_F, i] ** 2:
                slow[i] = 1.0
            elif heat[i] < 0.9 * act[lay.THR_F, i] ** 2:
                slow[i] = 0.0
            f_ref[i] = smooth * (1.0 - act[lay.THR_S, i] * slow[i])
            if act[lay.BRAKE_F, i] != 0.0:
                calm[i] = calm[i] + dt if abs(vm[i]) < BRAKE_SPEED else 0.0
                if calm[i] > BRAKE_WAIT_S and bite[i] == 0.0:
                    bite[i], stopped[i] = 1.0, xm[i]
                elif bite[i] != 0.0 and abs(xm[i] - stopped[i]) > BRAKE_WAY:
                    bite[i] = 0.0
        dynamics(
            kind,
            joints,
            neutral,
            body,
            legs,
            grav,
            q,
            qd,
            R,
            A,
            rho,
            J,
            M,
            bias,
            drift,
            Jc,
            drift_c,
        )
        invert(M, Mi)
        mean[:] = 0.0
        for i in range(n):
            x_last[i] = x_seen[i]
            rate[i] = 0.0
            for a in range(n):
                rate[i] += J[i, a] * qd[a]
        for s in range(substeps):
            for i in range(n):
                w = act[lay.CUR_W, i]
                current_rate[i] += (
                    h
                    * w
                    * (w * (f_ref[i] - current[i]) - 2.0 * act[lay.CUR_Z, i] * current_rate[i])
                )
                current[i] += h * current_rate[i]
                jump[i] += h / BANG_S * (jump_to[i] - jump[i])
                wind = xm[i] - rho[i] - jump[i]
                gap = 0.5 * act[lay.GAP, i]
                inside = min(max(wind, -gap), gap)
                wind -= inside
                tau[i] = act[lay.KT, i] * wind
                if gap == 0.0 or wind != 0.0:
                    pushed = tau[i] + act[lay.DT, i] * (vm[i] - rate[i])
                    tau[i] = 0.0 if gap != 0.0 and pushed * wind < 0.0 else pushed
                carried[i] += h / 1e-3 * (tau[i] - carried[i])
                _, ratio = _encoder(act, i, xm[i])
                motor = current[i]
                if act[lay.SUP_A, i] != 0.0:
                    motor += act[lay.SUP_A, i] * math.sin(
                        2.0 * math.pi * act[lay.SUP_HZ, i] * (t + s * h)
                    )
                force = act[lay.KF, i] * ratio * motor + _extra_force(act, i, xm[i], vm[i], t)
                force -= _cable(act, i, xm[i], vm[i]) + act[lay.HYS_F, i] * hz[i]
                warmth = 1.0
                if act[lay.WARM, i] != 0.0:
                    warmth += act[lay.WARM, i] * (
                        1.0 - math.exp(-max(t, 0.0) / act[lay.WARM_TAU, i])
                    )
                g = bound(act, i, vm[i], carried[i], act[lay.BRAKE_F, i] * bite[i], warmth)
                rub, steep = presliding(act, i, vm[i], g, z[i], h)
                drag = act[lay.VIS, i] * warmth
                top = act[lay.MR, i] * vm[i] + h * (force - tau[i] - rub + steep * vm[i])
                vm[i] = top / (act[lay.MR, i] + h * (drag + steep))
                xm[i] += h * vm[i]
                if act[lay.HYS_F, i] != 0.0:
                    hz[i] = bouc_wen(act, i, vm[i], hz[i], h)
            for c in range(3):
                a_c[c] = drift_c[c]
                for a in range(n):
                    a_c[c] += Jc[c, a] * qdd[a]
            pull[:] = 0.0
            if glob[lay.SIDE_M] != 0.0:
                w = glob[lay.SIDE_W]
                for c in range(3):
                    back = w * w * side[c] + 2.0 * glob[lay.SIDE_Z] * w * side_v[c]
                    side_v[c] -= h * (back + a_c[c] + floor_a[c])
                    side[c] += h * side_v[c]
                    pull[c] += glob[lay.SIDE_M] * (back + grav[c])
            if glob[lay.BASE_M] != 0.0:
                w, lag = glob[lay.BASE_W], body[0] / glob[lay.BASE_M]
                for c in range(2):
                    floor_a[c] = -lag * (a_c[c] + floor_a[c]) - w * w * floor[c]
                    floor_a[c] -= 2.0 * glob[lay.BASE_Z] * w * floor_v[c]
                    floor_v[c] += h * floor_a[c]
                    floor[c] += h * floor_v[c]
                    pull[c] -= body[0] * floor_a[c]
            for a in range(n):
                push[a] = -bias[a]
                for i in range(n):
                    push[a] += J[i, a] * tau[i]
                for c in range(3):
                    push[a] += Jc[c, a] * pull[c]
            for a in range(n):
                qdd[a] = 0.0
                for b in range(n):
                    qdd[a] += Mi[a, b] * push[b]
                qd[a] += h * qdd[a]
                q[a] += h * qd[a]
                mean[a] += qdd[a] / substeps
            for i in range(n):
                rate[i] = 0.0
                for a in range(n):
                    rate[i] += J[i, a] * qd[a]
                rho[i] += h * rate[i]
        for i in range(n):
            x_seen[i], ratio = _encoder(act, i, xm[i])
            v_seen[i] = 0.75 * ratio * vm[i] + 0.25 * (x_seen[i] - x_last[i]) / dt
            out[k, i] = x_seen[i]
            out[k, n + i] = current[i]
            if act[lay.SUP_A, i] != 0.0:
                out[k, n + i] += act[lay.SUP_A, i] * math.sin(
                    2.0 * math.pi * act[lay.SUP_HZ, i] * (t + dt)
                )
            out[k, 2 * n + i] = q[i]
        _feel(R, A, drift, qd, mean, imu_r, floor_a, grav, out[k, 3 * n :])
    return out


@njit(cache=True)
def _feel(R, A, drift, qd, qdd, imu_r, floor_a, grav, out):
    """Angular rate and specific force at the IMU, platform axes."""
    arm = R @ imu_r
    omega = A[3:6] @ qd
    turning = A[3:6] @ qdd + drift[3:6]
    felt = A[0:3] @ qdd + drift[0:3] + floor_a - grav
    felt += np.cross(turning, arm) + np.cross(omega, np.cross(omega, arm))
    out[0:3] = R.T @ omega
    out[3:6] = R.T @ felt
