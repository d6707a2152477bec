"""The whole rig in time, compiled: one tick of drives and plant, and runs up to an instant.

Tick k stands at k dt, dt the period of the speed loop. In a tick the drives take what has arrived, close
their loops on what their encoders say now, and the force that follows acts until the next tick.
"""

from __future__ import annotations

import math

import numpy as np

from hil.compiled import compiled, inner
from hil.sim import layout as lay
from hil.sim.drive_loops import (
    EPSILON_S,
    deliver,
    mean_force,
    position_loops,
    speed_loops,
)
from hil.sim.imu import filter_coefficients, filter_step, measure
from hil.sim.mechanics import memory, step
from hil.sim.model import split
from hil.sim.rest import read_encoders
from hil.sim.statics import static_forces, statics_memory


@inner
def put_outputs(st, tail, row):  # type: ignore[no-untyped-def]
    """One row of outputs (4 n + 6,): position, velocity, force as the drives see them, pose, IMU."""
    n = st.shape[1]
    for i in range(n):
        row[i] = st[lay.S_XD, i]
        row[n + i] = st[lay.S_VD, i]
        row[2 * n + i] = st[lay.S_CURRENT, i]
        row[3 * n + i] = st[lay.S_Q, i]
    for a in range(6):
        row[4 * n + a] = tail[a]


@compiled
def tick_memory(model, n, imu):  # type: ignore[no-untyped-def]
    """What `tick` works in, kept by its caller: the mechanics' memory, forces (n,), mean rates (n,), the IMU
    filters' coefficients (4, 4) and input (6,), the memory of static forces."""
    coefficients = np.empty((4, 4))
    if model[lay.H_IMU] != 0.0:
        filter_coefficients(imu, model[lay.H_DT] / model[lay.H_SUBSTEPS], coefficients)
    return memory(n), np.empty(n), np.empty(n), coefficients, np.empty(6), statics_memory(n)


@inner
def tick(model, views, st, tail, mem, with_imu):  # type: ignore[no-untyped-def]
    """From the tick the state stands at to the next; `views` of the model, `mem` from `tick_memory`."""
    act, _, geometry0, _, body0, gravity, gravity0, _, legs0, imu = views
    mechanics, force, rates, coefficients, sensed, statics = mem
    kind, n = int(model[lay.H_KIND]), st.shape[1]
    k = tail[lay.S_TAIL - 1]
    t = k * model[lay.H_DT]
    substeps = int(model[lay.H_SUBSTEPS])
    if model[lay.H_STATIC_FF] != 0.0 and int(k) % int(model[lay.H_POSITION_TICKS]) == 0:
        q, into = st[lay.S_Q], st[lay.S_STATIC]
        static_forces(statics, kind, geometry0, body0, legs0, gravity0, q, into)
    position_loops(model, act, st, t, int(k))
    speed_loops(model, act, st, t)
    h = model[lay.H_DT] / substeps
    for _ in range(substeps):
        for i in range(n):
            force[i] = mean_force(act, st, i)
            rates[i] = st[lay.S_QD, i]
        step(kind, views, st, mechanics, force, h)
        if with_imu:
            for i in range(n):
                rates[i] = 0.5 * (rates[i] + st[lay.S_QD, i])
            R, A, twist = mechanics[4][0], mechanics[4][1], mechanics[4][2]
            measure(R, A, twist, gravity, imu, rates, st[lay.S_QDD], sensed)
            filter_step(coefficients, imu, tail, sensed)
    read_encoders(act, st)
    tail[lay.S_TAIL - 1] = k + 1.0


@compiled
def advance(model, state, events, count, ring, to_s):  # type: ignore[no-untyped-def]
    """Run to the first tick at or after `to_s`; outputs of tick k go to ring[k % len(ring)].

    `events` (N, 3): arrival s, actuator, setpoint, of which the first `count` wait; those that arrive
    in time are delivered in their order. Returns how many still wait, moved to the front.
    """
    n = int(model[lay.H_N])
    views = split(model, n)
    st = state[: lay.S_ROWS * n].reshape((lay.S_ROWS, n))
    tail = state[lay.S_ROWS * n :]
    dt = model[lay.H_DT]
    k = int(tail[lay.S_TAIL - 1])
    if k * dt >= to_s - EPSILON_S:
        return count
    mem = tick_memory(model, n, views[9])
    with_imu = model[lay.H_IMU] != 0.0
    while k * dt < to_s - EPSILON_S:
        if count > 0:
            kept = 0
            for e in range(count):
                if events[e, 0] <= k * dt + EPSILON_S:
                    deliver(model, st, int(events[e, 1]), events[e, 2], events[e, 0])
                else:
                    for c in range(3):
                        events[kept, c] = events[e, c]
                    kept += 1
            count = kept
        tick(model, views, st, tail, mem, with_imu)
        k += 1
        put_outputs(st, tail, ring[k % ring.shape[0]])
    return count


@inner
def look_up(ring, tick_now, dt, t, column):  # type: ignore[no-untyped-def]
    """Output `column` at instant t by interpolation between ticks; the oldest kept where t is before it."""
    size = ring.shape[0]
    x = t / dt
    k = math.floor(x)
    oldest = max(tick_now - size + 1, 0)
    if k < oldest:
        return ring[oldest % size, column]
    if k >= tick_now:
        return ring[tick_now % size, column]
    a, b = ring[k % size, column], ring[(k + 1) % size, column]
    return a + (b - a) * (x - k)
