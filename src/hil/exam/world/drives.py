"""The drives of the exam's world: each on ticks of its own, speed from counted increments, soft limits.

A drive draws a line to each new setpoint in whole ticks of its own position loop; its speed is the
difference of quantised positions behind a first-order filter; what its loops ask for passes a soft knee
where an effect limits it. Ticks have a phase and a rate of their own, so they wander against the bus.
"""

from __future__ import annotations

import math

from hil.compiled import inner
from hil.exam.world import layout as lay

QUEUE = 4
KNEE = 10.0


@inner
def read_encoder(act, st, i, t):  # type: ignore[no-untyped-def]
    """(reading, slope) of drive i's encoder in the actuator's own units, counted."""
    x = st[lay.S_X, i] - act[lay.A_HOME, i]
    value = act[lay.A_HOME, i] + act[lay.A_OFFSET, i] + x / act[lay.A_LEAD, i]
    slope = 1.0 / act[lay.A_LEAD, i]
    if act[lay.A_LEAD_A, i] != 0.0:
        w = 2.0 * math.pi / act[lay.A_LEAD_P, i]
        value -= act[lay.A_LEAD_A, i] * math.sin(w * x)
        slope -= act[lay.A_LEAD_A, i] * w * math.cos(w * x)
    if act[lay.O_SLIP_X, i] != 0.0 and t >= act[lay.O_SLIP_T, i]:
        value += act[lay.O_SLIP_X, i]
    return value, slope


@inner
def soft_limit(value, limit):  # type: ignore[no-untyped-def]
    """`value`, bent over to +-limit with a knee."""
    if abs(value) < 0.3 * limit:
        return value
    return value / (1.0 + abs(value / limit) ** KNEE) ** (1.0 / KNEE)


@inner
def deliver(head, act, st, i, value, t):  # type: ignore[no-untyped-def]
    """A setpoint reaches drive i."""
    if head[lay.H_FORCES] != 0.0:
        st[lay.S_LEFT, i] = 1.0
        if head[lay.H_FORCE_LINEAR] != 0.0:
            st[lay.S_LEFT, i] = math.floor(head[lay.H_CYCLE] / act[lay.A_PERIOD_V, i] + 0.5)
        st[lay.S_SLOPE, i] = (value - st[lay.S_REF, i]) / st[lay.S_LEFT, i]
        return
    if act[lay.O_ROUND, i] > 0.0:
        value = math.floor(value / act[lay.O_ROUND, i] + 0.5) * act[lay.O_ROUND, i]
    if head[lay.H_RETIMED] == 0.0:
        st[lay.S_PENDING, i] = value
        st[lay.S_HAS_PENDING, i] = 1.0
        return
    if st[lay.S_IDLE, i] != 0.0:
        st[lay.S_IDLE, i] = 0.0
        st[lay.S_PLAY, i] = t + head[lay.H_CYCLE]
    n = int(st[lay.S_FIFO_N, i])
    if n == QUEUE:
        for k in range(QUEUE - 1):
            st[lay.S_FIFO + k, i] = st[lay.S_FIFO + k + 1, i]
        n -= 1
    st[lay.S_FIFO + n, i] = value
    st[lay.S_FIFO_N, i] = n + 1


@inner
def _line(head, act, st, i, target):  # type: ignore[no-untyped-def]
    """Draw a line from the present reference to `target` in whole ticks of one bus cycle."""
    if head[lay.H_LINEAR] == 0.0:
        st[lay.S_REF, i] = target
        st[lay.S_LEFT, i] = 0.0
        return
    ticks = max(1.0, math.floor(head[lay.H_CYCLE] / act[lay.A_PERIOD_P, i] + 0.5))
    slope = (target - st[lay.S_REF, i]) / ticks
    span = ticks * act[lay.A_PERIOD_P, i]
    st[lay.S_ACC, i] = (slope - st[lay.S_SLOPE, i]) / act[lay.A_PERIOD_P, i] / span
    st[lay.S_ACC_LEFT, i] = ticks
    st[lay.S_SLOPE, i] = slope
    st[lay.S_LEFT, i] = ticks


@inner
def position_tick(head, act, st, i, t):  # type: ignore[no-untyped-def]
    """One tick of drive i's position loop at instant t."""
    if head[lay.H_FORCES] != 0.0:
        return
    if st[lay.S_HAS_PENDING, i] != 0.0:
        st[lay.S_HAS_PENDING, i] = 0.0
        _line(head, act, st, i, st[lay.S_PENDING, i])
    elif head[lay.H_RETIMED] != 0.0 and st[lay.S_IDLE, i] == 0.0 and t >= st[lay.S_PLAY, i]:
        n = int(st[lay.S_FIFO_N, i])
        if n > 0:
            _line(head, act, st, i, st[lay.S_FIFO, i])
            for k in range(n - 1):
                st[lay.S_FIFO + k, i] = st[lay.S_FIFO + k + 1, i]
            st[lay.S_FIFO_N, i] = n - 1
        st[lay.S_PLAY, i] += head[lay.H_CYCLE]
    speed, target = 0.0, st[lay.S_REF, i]
    if st[lay.S_LEFT, i] > 0.0:
        st[lay.S_REF, i] += st[lay.S_SLOPE, i]
        st[lay.S_LEFT, i] -= 1.0
        speed = st[lay.S_SLOPE, i] / act[lay.A_PERIOD_P, i]
    elif st[lay.S_ACC_LEFT, i] <= -2.0:  # long since at rest: the next line starts from standstill
        st[lay.S_SLOPE, i] = 0.0
    st[lay.S_ACC_LEFT, i] -= 1.0
    acc = st[lay.S_ACC, i] if st[lay.S_ACC_LEFT, i] >= 0.0 else 0.0
    ahead = act[lay.A_KFA, i] * act[lay.A_MEFF, i] * acc
    if act[lay.A_KFF, i] != 0.0 and speed != 0.0:
        ahead += act[lay.A_KFF, i] * (
            act[lay.A_FF_VISCOUS, i] * speed + math.copysign(act[lay.A_FF_COULOMB, i], speed)
        )
    st[lay.S_FF, i] = ahead
    if head[lay.H_PD] != 0.0:
        st[lay.S_VREF, i] = act[lay.A_KFV, i] * speed
        st[lay.S_NOW, i] = target
        return
    v_ref = act[lay.A_KP, i] * (target - st[lay.S_READING, i])
    v_ref += act[lay.A_KFV, i] * speed
    v_ref = min(max(v_ref, -act[lay.A_SPEED_MAX, i]), act[lay.A_SPEED_MAX, i])
    if act[lay.A_SPEED_LIMIT, i] < act[lay.A_SPEED_MAX, i]:
        v_ref = soft_limit(v_ref, act[lay.A_SPEED_LIMIT, i])
    st[lay.S_VREF, i] = v_ref


@inner
def speed_tick(head, act, st, i, t):  # type: ignore[no-untyped-def]
    """One tick of drive i's speed loop: reads the encoder, filters its speed, sets the force reference."""
    reading, _ = read_encoder(act, st, i, t)
    count = math.floor(reading / act[lay.A_COUNT, i] + 0.5)
    period = act[lay.A_PERIOD_V, i]
    raw = (count - st[lay.S_COUNT, i]) * act[lay.A_COUNT, i] / period
    st[lay.S_COUNT, i] = count
    st[lay.S_READING, i] = count * act[lay.A_COUNT, i]
    st[lay.S_SPEED, i] += (raw - st[lay.S_SPEED, i]) * min(1.0, period / act[lay.A_SPEED_TAU, i])
    error = st[lay.S_VREF, i] - st[lay.S_SPEED, i]
    if head[lay.H_FORCES] != 0.0:
        if st[lay.S_LEFT, i] > 0.0:
            st[lay.S_REF, i] += st[lay.S_SLOPE, i]
            st[lay.S_LEFT, i] -= 1.0
        force = st[lay.S_REF, i]
    elif head[lay.H_PD] != 0.0:
        force = act[lay.A_KP, i] * (st[lay.S_NOW, i] - st[lay.S_READING, i]) + st[lay.S_FF, i]
        force += act[lay.A_KV, i] * error + act[lay.A_STATIC, i] * st[lay.S_STATIC, i]
    else:
        force = act[lay.A_KV, i] * error + st[lay.S_INTEGRAL, i] + st[lay.S_FF, i]
        force += act[lay.A_STATIC, i] * st[lay.S_STATIC, i]
    limit = act[lay.A_FORCE_MAX, i]
    out = min(max(force, -limit), limit)
    if act[lay.A_FORCE_LIMIT, i] < limit:
        out = soft_limit(out, act[lay.A_FORCE_LIMIT, i])
    if head[lay.H_PD] == 0.0 and head[lay.H_FORCES] == 0.0:
        past = abs(force) - min(limit, act[lay.A_FORCE_LIMIT, i])
        if past <= 0.0 or error * force < 0.0:
            st[lay.S_INTEGRAL, i] += act[lay.A_KI, i] * error * period
    if act[lay.O_CYCLE_F, i] != 0.0:
        wander = 1.5 * math.sin(0.9 * t) + math.sin(2.3 * t)
        out += act[lay.O_CYCLE_F, i] * math.sin(act[lay.O_CYCLE_W, i] * t + wander)
    st[lay.S_FREF, i] = out
