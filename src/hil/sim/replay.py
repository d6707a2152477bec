"""A whole record in one compiled call: setpoints in, the value of every signal at every instant asked for."""

from __future__ import annotations

import math

import numpy as np

from hil.compiled import compiled, inner
from hil.sim import layout as lay
from hil.sim.drive_loops import EPSILON_S, deliver
from hil.sim.imu import group_delay_s
from hil.sim.model import apply_parameters, split
from hil.sim.rest import REST_M, rest, state_size
from hil.sim.run import put_outputs, tick, tick_memory
from hil.sim.sensors import is_lost, reading, sampled_at, sensor_constants

SETTLED = 5.0
"""An error's rate is known after so many radians of the error's own swing."""


@inner
def _lead(st, i, error, t, w, last):  # type: ignore[no-untyped-def]
    """Let the model follow what was measured: `error` of actuator i's position at instant t.

    A spring and a damper from the model to the measurement, in proportion to the masses, so that in every
    direction it would swing with w rad/s, critically damped. They act until the next sample; `last`
    (3,): error, instant and rate.
    """
    if t > last[1]:
        step = t - last[1]
        last[2] += min(1.0, SETTLED * w * step) * ((error - last[0]) / step - last[2])
    last[0], last[1] = error, t
    st[lay.S_PULL, i] = w * w * error + 2.0 * w * last[2]


@compiled
def replay(  # type: ignore[no-untyped-def]
    base,
    p,
    start,
    modes,
    ticked,
    q_guess,
    ev_first,
    ev_t,
    ev_value,
    s_first,
    s_t,
    s_signal,
    seen,
    lead_w,
    out,
):
    """Run the record with parameters `p` on model `base`, from rest at actuator positions `start` (n,).

    `ticked`, a tuple of n: 1 for the drives that take each setpoint, at the instant it reaches them and half
    a tick, at a tick of their own. Its length is known when this is compiled, once for each n.

    Events of actuator i are ev_*[ev_first[i] : ev_first[i + 1]]: send instants s (rising) and setpoints.
    Samples of group g are [s_first[g] : s_first[g + 1]] of s_t (receive stamps s, rising) and `out`; its
    signal is s_signal[g]: as in `sensors.sensor_constants`, then n for the true pose, stamped when it held.
    The last of them lead the model to what was measured: positions `seen`, from the place in `out` on where
    they begin, with lead_w (rad/s) as in `_lead`.
    """
    n = len(ticked)
    model = np.empty_like(base)
    apply_parameters(base, p, model)
    state = np.empty(state_size(n))
    if not rest(model, start, modes, q_guess, state) < REST_M:
        out[:] = np.nan
        return
    views = split(model, n)
    act, imu = views[0], views[9]
    st = state[: lay.S_ROWS * n].reshape((lay.S_ROWS, n))
    tail = state[lay.S_ROWS * n :]
    for i in range(n):
        st[lay.S_TICKED, i] = ticked[i]
    groups = s_signal.shape[0]
    sensor, column = np.empty((groups, 5)), np.empty(groups, np.int64)
    home, delay, unit = np.zeros(groups), np.zeros(groups), np.ones(groups)
    with_imu = np.any((s_signal >= 4 * n) & (s_signal < 4 * n + 6))
    for g in range(groups):
        signal = s_signal[g]
        quantity, i = signal // n, signal % n
        if signal >= 4 * n + 6:
            column[g] = 3 * n + signal - (4 * n + 6)
            sensor[g, :] = 0.0
            sensor[g, lay.SCALE] = 1.0
            continue
        sensor_constants(p, n, signal, sensor[g])
        if signal >= 4 * n:
            column[g] = signal
            delay[g] = model[lay.H_IMU_DELAY] - group_delay_s(imu[12])
            continue
        delay[g] = model[lay.H_ANSWER_DELAY]
        column[g] = signal if quantity < 3 else 2 * n + i
        if quantity == 0:
            home[g] = act[lay.A_HOME, i]
        elif quantity == 3:
            unit[g] = act[lay.A_FORCE_PER_A, i]
    lost = p[n * lay.ACTUATOR_BLOCK + lay.BUS_AT]
    mem = tick_memory(model, n, imu)
    dt = model[lay.H_DT]
    rows = np.empty((2, 4 * n + 6))
    put_outputs(st, tail, rows[0])
    put_outputs(st, tail, rows[1])
    ev, at = ev_first[:-1].copy(), s_first[:-1].copy()
    due = np.empty(groups)
    for g in range(groups):
        due[g] = np.inf
        if at[g] < s_first[g + 1]:
            due[g] = sampled_at(s_t[at[g]] - delay[g], sensor[g, 2], sensor[g, 4], 0.0)
    leads = out.shape[0] - seen.shape[0]
    last = np.zeros((n, 3))
    last[:, 1] = math.inf
    k, earliest = 0, -np.inf
    while True:
        if earliest <= k * dt:
            earliest = np.inf
            for g in range(groups):  # everything that lies between the last tick and this one
                while due[g] <= k * dt:
                    x = min(max((due[g] - (k - 1) * dt) / dt, 0.0), 1.0)
                    c = column[g]
                    value = (rows[0, c] + (rows[1, c] - rows[0, c]) * x) / unit[g]
                    out[at[g]] = reading(value, home[g], sensor[g, 0], sensor[g, 1], sensor[g, 3])
                    if at[g] >= leads:
                        error = seen[at[g] - leads] - out[at[g]]
                        _lead(st, s_signal[g], error, due[g], lead_w, last[s_signal[g]])
                    at[g] += 1
                    due[g] = np.inf
                    if at[g] < s_first[g + 1]:
                        due[g] = sampled_at(s_t[at[g]] - delay[g], sensor[g, 2], sensor[g, 4], 0.0)
                earliest = min(earliest, due[g])
            if earliest == np.inf:
                return
        for i in range(n):
            wait = model[lay.H_SETPOINT_DELAY] + act[lay.A_DELAY, i]
            while ev[i] < ev_first[i + 1] and ev_t[ev[i]] + wait <= k * dt + EPSILON_S:
                e = ev[i]
                if not is_lost(i, e - ev_first[i], lost):
                    deliver(model, st, i, ev_value[e], ev_t[e] + wait)
                ev[i] += 1
        is_due = earliest <= (k + 1) * dt
        if is_due:
            put_outputs(st, tail, rows[0])
        tick(model, views, st, tail, mem, with_imu)
        k += 1
        if is_due:
            put_outputs(st, tail, rows[1])
