"""The world's clockwork: drives, motors with friction, elastic transmissions, a rigid body on six members.

No constraint is solved. Each member (a leg, a slide, a guide) is a stiff spring between base and body; the
actuated ones have a motor with a mass of its own behind the spring. The base frame itself rocks on the floor.
"""

from __future__ import annotations

from math import cos, exp, pi, sin, sqrt

import numpy as np
from numba import njit

from benchmarks.third_lab import columns as c
from benchmarks.third_lab.friction import hysteresis, level, slide, warmth

SUBSTEPS = 3
"""Integration steps in a tick of the speed loop: 83 µs, 12 to a period of the stiffest mode and more."""

STRUT, PLANE, LINE = 0, 1, 2
"""Kinds of member: joint to joint; seen in the xz-plane (cylindrical joints along y); along a fixed line."""


@njit(cache=True)
def rotation(q: np.ndarray, R: np.ndarray) -> None:
    """Rotation matrix of the unit quaternion `q` (w, x, y, z) into `R`."""
    w, x, y, z = q[0], q[1], q[2], q[3]
    R[0, 0] = 1 - 2 * (y * y + z * z)
    R[0, 1] = 2 * (x * y - w * z)
    R[0, 2] = 2 * (x * z + w * y)
    R[1, 0] = 2 * (x * y + w * z)
    R[1, 1] = 1 - 2 * (x * x + z * z)
    R[1, 2] = 2 * (y * z - w * x)
    R[2, 0] = 2 * (x * z - w * y)
    R[2, 1] = 2 * (y * z + w * x)
    R[2, 2] = 1 - 2 * (x * x + y * y)


@njit(cache=True)
def multiply(A: np.ndarray, x: np.ndarray, out: np.ndarray) -> None:
    """A x into `out`, all of three."""
    for k in range(3):
        out[k] = A[k, 0] * x[0] + A[k, 1] * x[1] + A[k, 2] * x[2]


@njit(cache=True)
def turn(q: np.ndarray, w: np.ndarray, dt: float) -> None:
    """Turn `q` by the body-frame rate `w` for `dt`."""
    a, b, cc, d = q[0], q[1], q[2], q[3]
    x, y, z = 0.5 * dt * w[0], 0.5 * dt * w[1], 0.5 * dt * w[2]
    q[0] = a - b * x - cc * y - d * z
    q[1] = b + a * x + cc * z - d * y
    q[2] = cc + a * y + d * x - b * z
    q[3] = d + a * z + b * y - cc * x
    norm = sqrt(q[0] ** 2 + q[1] ** 2 + q[2] ** 2 + q[3] ** 2)
    for k in range(4):
        q[k] /= norm


@njit(cache=True)
def spring(row: np.ndarray, bend: float, rate: float) -> float:
    """Force (N) of a transmission bent by `bend`, with play and soft flanks."""
    over = abs(bend) - 0.5 * row[c.GAP]
    if over <= 0.0:
        return 0.0
    flank = row[c.FLANK]
    if over < flank:
        force = 0.5 * row[c.STIFFNESS] * over * over / flank
    else:
        force = row[c.STIFFNESS] * (over - 0.5 * flank)
    hold = min(over / flank, 1.0) if flank > 0.0 else 1.0
    return (force if bend > 0.0 else -force) + hold * row[c.DAMPING] * rate


@njit(cache=True)
def load_extras(row: np.ndarray, length: float, rate: float) -> float:
    """Forces (N, positive lengthens) that act on the load itself: guides' drag, air, stop, cable."""
    force = -row[c.LOAD_VISCOUS] * rate - row[c.DRAG] * rate * abs(rate)
    force -= row[c.CABLE_K] * (length - row[c.CABLE_X])
    depth = length - row[c.STOP_X]
    if depth > 0.0:
        force -= max(row[c.STOP_K] * depth * (1.0 + 0.6 * rate), 0.0)
    return force


@njit(cache=True)
def simulate(
    act: np.ndarray,  # (n, columns.COUNT)
    kind: np.ndarray,  # (6,) of member
    actuated: np.ndarray,  # (6,) its actuator or -1
    joints: np.ndarray,  # (6, 3) in the platform frame from the centre of gravity, m
    base: np.ndarray,  # (6, 3) in the base frame, m
    line: np.ndarray,  # (6, 3) direction of a LINE member
    passive: np.ndarray,  # (6, 3) length, stiffness and damping where not actuated
    mass: float,
    inertia: np.ndarray,
    gravity: np.ndarray,  # (3,) in the base frame
    floor: np.ndarray,  # (3, 3) frame's mass, stiffness, damping along x, y, z
    slosh: np.ndarray,  # (6,) mass, x, y, z from the cog, stiffness, damping of what came loose
    sensor: np.ndarray,  # (3,) IMU from the cog, m
    start: np.ndarray,  # (7,) cog and quaternion at rest
    hold: np.ndarray,  # (n,) integrators at rest, N
    motors: np.ndarray,  # (n,) motors' counted positions at rest, m
    arrivals: np.ndarray,  # (n, K) s, inf where no more come
    setpoints: np.ndarray,  # (n, K) m
    phases: np.ndarray,  # (n,) which speed ticks are position ticks
    weaken: np.ndarray,  # (ms,) factor on the torque of a drive with dropouts
    t0: float,
    ticks: int,
    cycle: float,
    dt_speed: float,
    every: int,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Drive positions and forces (n, ticks) and the IMU's six (6, ticks), one column a speed tick from t0."""
    n = len(act)
    dt = dt_speed / SUBSTEPS
    positions, forces, imu = np.empty((n, ticks)), np.empty((n, ticks)), np.empty((6, ticks))
    p, q = start[:3].copy(), start[3:].copy()
    v, w = np.zeros(3), np.zeros(3)
    s, sv = np.zeros(3), np.zeros(3)
    u, uv = np.zeros(2), np.zeros(2)
    R = np.empty((3, 3))
    inverse = np.linalg.inv(inertia)
    x, xv = motors.copy(), np.zeros(n)
    counted, speed = motors.copy(), np.zeros(n)
    reference, origin, target = motors.copy(), motors.copy(), motors.copy()
    began, taken = np.full(n, -1e9), np.zeros(n, np.int64)
    wanted, integral = np.zeros(n), hold.copy()
    asked, current = hold.copy(), hold.copy()
    bristles, bent = np.zeros((n, 4)), np.zeros(n)
    brake, slipped, carried = np.ones(n), np.zeros(n), hold.copy()
    fade = np.empty(n)
    acc, alpha, turned = np.zeros(3), np.zeros(3), np.zeros(3)
    pull, torque, shove, local, spun = (
        np.zeros(3),
        np.zeros(3),
        np.zeros(3),
        np.zeros(3),
        np.zeros(3),
    )
    for i in range(n):
        fade[i] = 1.0 - exp(-2.0 * pi * act[i, c.CURRENT_HZ] * dt)
    for tick in range(ticks):
        t = t0 + tick * dt_speed
        for i in range(n):
            row = act[i]
            seen = np.floor(x[i] / row[c.ENCODER_STEP] + 0.5) * row[c.ENCODER_STEP]
            raw = (seen - counted[i]) / dt_speed
            speed[i] += (raw - speed[i]) * (1.0 - exp(-dt_speed / row[c.SPEED_FILTER]))
            counted[i] = seen
            if (tick + phases[i]) % every == 0:
                share = min((t - began[i]) / cycle, 1.0)
                reference[i] = origin[i] + (target[i] - origin[i]) * share
                while arrivals[i, taken[i]] <= t:
                    origin[i], target[i] = reference[i], setpoints[i, taken[i]]
                    began[i] = t
                    taken[i] += 1
                limit = row[c.SPEED_LIMIT]
                wanted[i] = min(max(row[c.POSITION_GAIN] * (reference[i] - seen), -limit), limit)
            gain = row[c.SPEED_GAIN]
            if abs(wanted[i]) < row[c.SCHEDULE_V]:
                gain *= 1.0 - row[c.SCHEDULE]
            error = wanted[i] - speed[i]
            most = min(row[c.FORCE_LIMIT], row[c.POWER] / max(abs(speed[i]), 1e-6))
            ask = gain * error + integral[i]
            if abs(ask) < most or ask * error < 0.0:
                integral[i] += row[c.INTEGRAL_GAIN] * error * dt_speed
            asked[i] = min(max(ask, -most), most)
            positions[i, tick] = seen
            forces[i, tick] = current[i]
        for _ in range(SUBSTEPS):
            rotation(q, R)
            fx, fy, fz = mass * gravity[0], mass * gravity[1], mass * gravity[2]
            tx, ty, tz = 0.0, 0.0, 0.0
            bx, by, bz = 0.0, 0.0, 0.0
            wx = R[0, 0] * w[0] + R[0, 1] * w[1] + R[0, 2] * w[2]
            wy = R[1, 0] * w[0] + R[1, 1] * w[1] + R[1, 2] * w[2]
            wz = R[2, 0] * w[0] + R[2, 1] * w[1] + R[2, 2] * w[2]
            for m in range(6):
                j = joints[m]
                ax = R[0, 0] * j[0] + R[0, 1] * j[1] + R[0, 2] * j[2]
                ay = R[1, 0] * j[0] + R[1, 1] * j[1] + R[1, 2] * j[2]
                az = R[2, 0] * j[0] + R[2, 1] * j[1] + R[2, 2] * j[2]
                ux = p[0] + ax - base[m, 0] - s[0]
                uy = p[1] + ay - base[m, 1] - s[1]
                uz = p[2] + az - base[m, 2] - s[2]
                if kind[m] == LINE:
                    length = line[m, 0] * ux + line[m, 1] * uy + line[m, 2] * uz
                    ux, uy, uz = line[m, 0], line[m, 1], line[m, 2]
                else:
                    if kind[m] == PLANE:
                        uy = 0.0
                    length = sqrt(ux * ux + uy * uy + uz * uz)
                    ux, uy, uz = ux / length, uy / length, uz / length
                rate = ux * (v[0] + wy * az - wz * ay - sv[0])
                rate += uy * (v[1] + wz * ax - wx * az - sv[1])
                rate += uz * (v[2] + wx * ay - wy * ax - sv[2])
                i = actuated[m]
                if i < 0:
                    push = passive[m, 1] * (passive[m, 0] - length) - passive[m, 2] * rate
                else:
                    row = act[i]
                    reach = row[c.HOME] + row[c.LEAD] * (x[i] - row[c.HOME])
                    slope = row[c.LEAD]
                    if row[c.LEAD_AMPLITUDE] != 0.0:
                        turns = 2.0 * pi / row[c.LEAD_PERIOD]
                        angle = turns * (x[i] - row[c.HOME]) + row[c.LEAD_PHASE]
                        reach += row[c.LEAD_AMPLITUDE] * sin(angle)
                        slope += row[c.LEAD_AMPLITUDE] * turns * cos(angle)
                    bend = reach + row[c.OFFSET] - length - slipped[i]
                    push = spring(row, bend, slope * xv[i] - rate)
                    if abs(push) > row[c.SLIP]:
                        over = abs(push) - row[c.SLIP]
                        slipped[i] += (over if push > 0.0 else -over) / row[c.STIFFNESS]
                        push = row[c.SLIP] if push > 0.0 else -row[c.SLIP]
                    carried[i] = push * slope
                    push += load_extras(row, length, rate)
                ux, uy, uz = push * ux, push * uy, push * uz
                fx, fy, fz = fx + ux, fy + uy, fz + uz
                bx, by, bz = bx - ux, by - uy, bz - uz
                tx += ay * uz - az * uy
                ty += az * ux - ax * uz
                tz += ax * uy - ay * ux
            pull[0], pull[1], pull[2] = fx, fy, fz
            torque[0], torque[1], torque[2] = tx, ty, tz
            shove[0], shove[1], shove[2] = bx, by, bz
            if slosh[0] > 0.0:
                arm = R @ slosh[1:4]
                loose = np.zeros(3)
                inside = R.T @ (acc + np.cross(alpha, arm) - gravity)
                for k in range(2):
                    grip = slosh[4] * u[k] + slosh[5] * uv[k]
                    loose[k] = grip
                    uv[k] += dt * (-grip / slosh[0] - inside[k])
                    u[k] += dt * uv[k]
                loose[2] = -slosh[0] * inside[2]
                at = R @ loose
                pull += at
                torque += np.cross(arm, at)
            multiply(R.T, torque, local)
            multiply(inertia, w, spun)
            local[0] -= w[1] * spun[2] - w[2] * spun[1]
            local[1] -= w[2] * spun[0] - w[0] * spun[2]
            local[2] -= w[0] * spun[1] - w[1] * spun[0]
            multiply(inverse, local, turned)
            multiply(R, turned, alpha)
            for k in range(3):
                acc[k] = pull[k] / mass
                sv[k] += dt * (shove[k] - floor[1, k] * s[k] - floor[2, k] * sv[k]) / floor[0, k]
                s[k] += dt * sv[k]
                v[k] += dt * acc[k]
                w[k] += dt * turned[k]
                p[k] += dt * v[k]
            turn(q, w, dt)
            for i in range(n):
                row = act[i]
                current[i] += fade[i] * (asked[i] - current[i])
                drive = row[c.TORQUE] * current[i]
                if row[c.DROPOUT] != 0.0 and t > 0.0:
                    drive *= weaken[min(int(t * 1000.0), len(weaken) - 1)]
                wave = 2.0 * pi * x[i] / row[c.RIPPLE_PERIOD] + row[c.RIPPLE_PHASE]
                drive += row[c.RIPPLE] * (sin(wave) + row[c.RIPPLE_SECOND] * sin(2.0 * wave))
                drive += row[c.PUMP] * sin(2.0 * pi * row[c.PUMP_HZ] * t + row[c.PUMP_PHASE])
                dx = xv[i] * dt
                plus, minus = level(row, xv[i], x[i], carried[i], t, brake[i])
                bent[i] = hysteresis(row, bent[i], dx)
                resist = slide(row, bristles[i], dx, plus, minus) + row[c.HYST_FORCE] * bent[i]
                resist += row[c.VISCOUS] * warmth(row, t) * xv[i]
                still = abs(xv[i]) < 0.001
                brake[i] += dt * ((1.0 - brake[i]) / 0.05 if still else -brake[i] / 0.3)
                xv[i] += dt * (drive - resist - carried[i]) / row[c.REFLECTED]
                x[i] += dt * xv[i]
        arm = R @ sensor
        spin = R @ w
        felt = acc + np.cross(alpha, arm) + np.cross(spin, np.cross(spin, arm)) - gravity
        imu[:3, tick] = w
        imu[3:, tick] = R.T @ felt
    return positions, forces, imu
