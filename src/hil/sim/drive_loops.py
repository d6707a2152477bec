"""The servo drive: setpoints into a reference, P position loop, PI speed loop, current-loop lag.

Drive model of the project's rigs [M: CDD3000 class drive]: setpoints arrive each bus cycle T_c; the drive
runs in a straight line to a new one over one T_c, from the first position-loop tick after its arrival, or
jumps (`hold`). The line starts where the one before it would be by then (`linear`), or where the last tick
was, so that the drive rests for a tick (`linear_rests`), or it started a tick ago, so that its first step is
made as the setpoint is taken (`linear_leads`). Forces that the drive is told it takes at once, or
along such a line from their arrival on. `retimed`: setpoints wait in a queue and the drive takes one each
T_c of its own clock, which starts one cycle after the first arrival (`clock_wait`: all drives so long after
that of the first): a frame that is late by less than three quarters of a cycle does not show, if it comes in
time. Where one was lost or came later the drive pauses a cycle, and takes the next when its turn is.
Law "cascade_static": the speed loop's force has K_s F_static beside it, as the law "pd" has [R].
Law "pd": F = K_p (x_ref - x) + K_d (k_fv x_ref' - v) + K_s F_static ("Towards Simulating a Mid-size Stewart
Platform on a Large Hexapod Simulator", eqs (7)-(8), with damping on the speed error [R]).

A setpoint's delay therefore counts in whole ticks. With the model's flag for smooth arrivals the line starts
half a position tick after the arrival, between ticks: the mean of the real start, smooth in every delay.
Where that is known to be a tick of the drive's own clock (S_TICKED), its loop counts its ticks from there: a
force that is read soon after a setpoint arrived depends on whether the loop has had its tick.

Mode off: no current; the holding brake is closed and acts as friction of F_max. It opens when the drive
is enabled with position setpoints at once, with force setpoints at the first of them.
"""

from __future__ import annotations

import math

from hil.compiled import inner
from hil.sim import layout as lay

EPSILON_S = 1e-9
"""Instants nearer than this are the same: ticks are products k dt, rounded."""
QUEUE = 4
LATEST = 0.75
"""Of a cycle: what waited shorter by more than that is not the setpoint whose turn it is, or came too
late for it."""
SKIPS = 0.5
"""Of a cycle: where a newer one waited shorter by no more than that, those before have had their turn."""


@inner
def encoder(act, i, x):  # type: ignore[no-untyped-def]
    """(reading, d reading / d x) of the motor encoder where the motor stands at output position x."""
    home = act[lay.A_HOME, i]
    ratio = act[lay.A_PER_LEAD, i]
    reading = home + act[lay.A_OFFSET, i] + (x - home) * ratio
    if act[lay.A_LEAD_A, i] != 0.0:
        w = 2.0 * math.pi / act[lay.A_LEAD_P, i]
        turn = w * (x - home) + act[lay.A_LEAD_PHASE, i]
        reading -= act[lay.A_LEAD_A, i] * math.sin(turn)
        ratio -= act[lay.A_LEAD_A, i] * w * math.cos(turn)
    return reading, ratio


@inner
def set_mode(act, st, i, mode):  # type: ignore[no-untyped-def]
    """Switch drive i; in "position" it holds where it stands until a setpoint comes, without a jump of force
    where it had one."""
    carried = st[lay.S_CURRENT, i]
    if carried != 0.0:
        carried -= act[lay.A_STATIC_FF, i] * st[lay.S_STATIC, i]
    st[lay.S_INTEGRAL, i] = carried if mode == lay.MODE_POSITION else 0.0
    st[lay.S_MODE, i] = mode
    st[lay.S_BRAKE, i] = 0.0 if mode == lay.MODE_POSITION else 1.0
    asked = st[lay.S_XD, i] if mode == lay.MODE_POSITION else 0.0
    st[lay.S_X0, i] = asked
    st[lay.S_X1, i] = asked
    for row in (
        lay.S_SLOPE, lay.S_AREF, lay.S_VREF, lay.S_FF, lay.S_VHELD, lay.S_FHELD, lay.S_HAS_PENDING,
        lay.S_FIFO_N, lay.S_FREF,
    ):  # fmt: skip
        st[row, i] = 0.0
    st[lay.S_T0, i] = -1.0
    st[lay.S_T1, i] = -1.0
    st[lay.S_IDLE, i] = 1.0


@inner
def deliver(header, st, i, value, t):  # type: ignore[no-untyped-def]
    """A setpoint, meant as the drive's mode says, reaches drive i at instant t; mode off ignores it."""
    if st[lay.S_MODE, i] == lay.MODE_FORCE:
        _start_segment(header, header[lay.H_FORCE_LINEAR], st, i, value, t)
        st[lay.S_BRAKE, i] = 0.0
    elif st[lay.S_MODE, i] == lay.MODE_POSITION:
        if header[lay.H_RETIMED] == 0.0:
            st[lay.S_PENDING, i] = value
            st[lay.S_PENDING_T, i] = t
            st[lay.S_HAS_PENDING, i] = 1.0
            return
        if st[lay.S_IDLE, i] != 0.0:
            st[lay.S_PLAY, i] = t + _wait_s(header, i)
            st[lay.S_IDLE, i] = 0.0
        n = int(st[lay.S_FIFO_N, i])
        if n == QUEUE:  # too full: the oldest goes
            _drop_oldest(st, i, n)
            n -= 1
        st[lay.S_FIFO + n, i] = value
        st[lay.S_FIFO_T + n, i] = t
        st[lay.S_FIFO_N, i] = n + 1


@inner
def _wait_s(header, i):  # type: ignore[no-untyped-def]
    """How long a setpoint that is in time waits for the clock of drive i."""
    return header[lay.H_CLOCK_WAIT] - i * header[lay.H_EARLIER]


@inner
def _drop_oldest(st, i, n):  # type: ignore[no-untyped-def]
    for k in range(n - 1):
        st[lay.S_FIFO + k, i] = st[lay.S_FIFO + k + 1, i]
        st[lay.S_FIFO_T + k, i] = st[lay.S_FIFO_T + k + 1, i]


@inner
def reference(st, i, t):  # type: ignore[no-untyped-def]
    """(position, speed), or (force, slope), that drive i's present segment asks for at instant t."""
    if t >= st[lay.S_T1, i] - EPSILON_S:
        return st[lay.S_X1, i], 0.0
    return st[lay.S_X0, i] + st[lay.S_SLOPE, i] * (t - st[lay.S_T0, i]), st[lay.S_SLOPE, i]


@inner
def _start_segment(header, lines, st, i, target, t):  # type: ignore[no-untyped-def]
    """`lines`: how the drive goes there, as H_LINEAR says it."""
    if lines == 0.0:
        st[lay.S_X1, i] = target
        st[lay.S_T1, i] = t - header[lay.H_DT]  # it holds at once, even if taken a little early
        return
    cycle = header[lay.H_CYCLE]
    tick = header[lay.H_DT] * header[lay.H_POSITION_TICKS]
    begins = t - tick if lines == lay.LEADS else t
    start, _ = reference(st, i, t - tick if lines == lay.RESTS else begins)
    # A segment that ended a moment ago (jitter) still counts as the speed before.
    before = st[lay.S_SLOPE, i] if t <= st[lay.S_T1, i] + 0.5 * cycle else 0.0
    slope = (target - start) / cycle
    st[lay.S_AREF, i] = (slope - before) / cycle
    st[lay.S_SLOPE, i] = slope
    st[lay.S_X0, i] = start
    st[lay.S_X1, i] = target
    st[lay.S_T0, i] = begins
    st[lay.S_T1, i] = begins + cycle


@inner
def _next(st, i, n, wait, cycle):  # type: ignore[no-untyped-def]
    """Which of the n setpoints in the queue of drive i has its turn now; -1 where none has. `wait`: how long
    one that is in time waits, s."""
    taken = -1
    for k in range(n):
        late = wait - (st[lay.S_PLAY, i] - st[lay.S_FIFO_T + k, i] + EPSILON_S)
        if late <= SKIPS * cycle or (taken < 0 and late <= LATEST * cycle):
            taken = k
    return taken


@inner
def _play(header, st, i, t):  # type: ignore[no-untyped-def]
    """A drive with its own clock takes the next setpoint from its queue when that clock says so."""
    if (
        header[lay.H_RETIMED] == 0.0
        or st[lay.S_IDLE, i] != 0.0
        or t < st[lay.S_PLAY, i] - EPSILON_S
    ):
        return
    n = int(st[lay.S_FIFO_N, i])
    taken = _next(st, i, n, _wait_s(header, i), header[lay.H_CYCLE])
    if taken >= 0:
        target = st[lay.S_FIFO + taken, i]
        for _ in range(taken + 1):
            _drop_oldest(st, i, n)
            n -= 1
        st[lay.S_FIFO_N, i] = n
        _start_segment(header, header[lay.H_LINEAR], st, i, target, st[lay.S_PLAY, i])
    elif n == 0 and st[lay.S_PLAY, i] > st[lay.S_T1, i] + 2.0 * header[lay.H_CYCLE]:
        st[lay.S_IDLE, i] = 1.0
    st[lay.S_PLAY, i] += header[lay.H_CYCLE]


@inner
def limited(value, limit, knee):  # type: ignore[no-untyped-def]
    """`value` within +-limit: cut off there, or by a `knee` > 0 bent over to it along a parabola, which
    begins a knee's share of the limit below it and ends as far above."""
    size, width = abs(value), knee * limit
    if size <= limit - width:
        return value
    if size >= limit + width:
        return math.copysign(limit, value)
    return math.copysign(limit - (limit + width - size) ** 2 / (4.0 * width), value)


@inner
def position_loops(header, act, st, t, k):  # type: ignore[no-untyped-def]
    """Position loops of the drives that have a tick in the model's k-th step: take setpoints, set speed
    reference and pre-control.

    A drive's own tick lies anywhere in the step: what it sets is then that step's mean, so that all answers
    are smooth in where it lies.
    """
    ticks = int(header[lay.H_POSITION_TICKS])
    phase = float(k % ticks)
    half = 0.5 * header[lay.H_DT] * ticks
    for i in range(st.shape[1]):
        if st[lay.S_MODE, i] != lay.MODE_POSITION:
            continue
        is_ticked = ticks > 1 and st[lay.S_TICKED, i] != 0.0
        start, soon = t, EPSILON_S
        who = header[lay.H_SMOOTH]
        if who == lay.ALL_SMOOTH or (who == lay.TICKED_SMOOTH and is_ticked):
            start = st[lay.S_PENDING_T, i] + half
            if is_ticked:
                soon = header[lay.H_DT] - EPSILON_S
        taken = st[lay.S_HAS_PENDING, i] != 0.0 and start <= t + soon
        if taken and is_ticked:
            st[lay.S_PHASE, i] = phase + max(start - t, 0.0) / header[lay.H_DT]
        whole = math.floor(st[lay.S_PHASE, i])
        st[lay.S_VREF, i], st[lay.S_FF, i] = st[lay.S_VHELD, i], st[lay.S_FHELD, i]
        if whole != phase:
            continue
        before = st[lay.S_PHASE, i] - whole
        ahead_s = before * header[lay.H_DT]
        if taken:
            st[lay.S_HAS_PENDING, i] = 0.0
            _start_segment(header, header[lay.H_LINEAR], st, i, st[lay.S_PENDING, i], start)
        _play(header, st, i, t)
        x_ref, speed = reference(st, i, t + ahead_s)
        cycle_ends = st[lay.S_T0, i] + header[lay.H_CYCLE] - EPSILON_S
        acceleration = st[lay.S_AREF, i] if t + ahead_s < cycle_ends else 0.0
        ahead = act[lay.A_KFA, i] * act[lay.A_MEFF, i] * acceleration
        if act[lay.A_KFF, i] != 0.0 and speed != 0.0:
            coulomb = math.copysign(act[lay.A_FF_COULOMB, i], speed)
            ahead += act[lay.A_KFF, i] * (act[lay.A_FF_VISCOUS, i] * speed + coulomb)
        x = st[lay.S_XD, i] + st[lay.S_VD, i] * ahead_s
        v_ref = act[lay.A_KP, i] * (x_ref - x) + act[lay.A_KFV, i] * speed
        st[lay.S_VHELD, i] = limited(v_ref, act[lay.A_VMAX, i], act[lay.A_VKNEE, i])
        st[lay.S_FHELD, i] = ahead
        st[lay.S_VREF, i] += (1.0 - before) * (st[lay.S_VHELD, i] - st[lay.S_VREF, i])
        st[lay.S_FF, i] += (1.0 - before) * (ahead - st[lay.S_FF, i])


@inner
def speed_loops(header, act, st, t):  # type: ignore[no-untyped-def]
    """One tick of every drive's speed loop (or "pd" law): sets the force reference."""
    dt = header[lay.H_DT]
    for i in range(st.shape[1]):
        limit, knee = act[lay.A_FMAX, i], act[lay.A_FKNEE, i]
        if st[lay.S_MODE, i] == lay.MODE_OFF:
            st[lay.S_FREF, i] = 0.0
        elif st[lay.S_MODE, i] == lay.MODE_FORCE:
            told, _ = reference(st, i, t)
            st[lay.S_FREF, i] = limited(told, limit, knee)
        elif act[lay.A_PD, i] != 0.0:
            _play(header, st, i, t)
            x_ref, speed = reference(st, i, t)
            force = act[lay.A_KP, i] * (x_ref - st[lay.S_XD, i])
            force += act[lay.A_KV, i] * (act[lay.A_KFV, i] * speed - st[lay.S_VD, i])
            force += act[lay.A_STATIC_FF, i] * st[lay.S_STATIC, i] + st[lay.S_FF, i]
            st[lay.S_FREF, i] = limited(force, limit, knee)
        else:
            error = st[lay.S_VREF, i] - st[lay.S_VD, i]
            force = act[lay.A_KV, i] * error + st[lay.S_INTEGRAL, i] + st[lay.S_FF, i]
            force += act[lay.A_STATIC_FF, i] * st[lay.S_STATIC, i]
            st[lay.S_FREF, i] = limited(force, limit, knee)
            if (
                abs(force) <= limit or force * error <= 0.0
            ):  # anti-windup: no further into the limit
                st[lay.S_INTEGRAL, i] += act[lay.A_KI, i] * error * dt


@inner
def mean_force(act, st, i):  # type: ignore[no-untyped-def]
    """Advance current loop i by a step; returns the mean over it of the force that its current stands for."""
    deviation = st[lay.S_CURRENT, i] - st[lay.S_FREF, i]
    st[lay.S_CURRENT, i] = st[lay.S_FREF, i] + deviation * act[lay.A_CURRENT_DECAY, i]
    return st[lay.S_FREF, i] + deviation * act[lay.A_CURRENT_MEAN, i]
