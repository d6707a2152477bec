"""A sender that is late, or misses cycles, is not taken for one that is too fast, nor does it win anything.

The sender's schedule has one setpoint a cycle, each late by up to a cycle; cycles that it cannot keep are
skipped, and the motion goes on from where it was.
"""

from __future__ import annotations

import math

from hypothesis import given
from hypothesis import strategies as st

from hil.safety import Gate
from tests.safety.bench import CYCLE_S, BenchMeaning, limits, on, speed

SPEED_MAX, ACCELERATION_MAX = 20.0 / CYCLE_S, 20.0 / CYCLE_S**2
LAST_CYCLE = 40

late = st.lists(
    st.tuples(st.floats(0.0, 0.999), st.integers(0, 3)), min_size=LAST_CYCLE, max_size=LAST_CYCLE
)
"""How late each frame is, and how many cycles are skipped before it."""


def armed(kind: str = "position") -> Gate:
    gate = Gate(limits(kind), BenchMeaning())
    gate.arm()
    return gate


def instants(delays: list[tuple[float, int]]) -> list[float]:
    """When the frames leave, cycles."""
    cycle, out = 0, []
    for delay, skipped in delays:
        cycle += 1 + skipped
        out.append(cycle + delay)
    return out


@given(late, st.floats(0.05, 1.0), st.floats(0.0, 6.28))
def test_a_motion_within_the_limits_passes_however_late_it_is_told(
    delays: list[tuple[float, int]], share: float, phase: float
) -> None:
    gate = armed()
    amplitude = 60.0
    omega = min(SPEED_MAX / amplitude, math.sqrt(ACCELERATION_MAX / amplitude)) * share * CYCLE_S
    for k, t in enumerate(instants(delays)):
        # from rest, and gently so: what comes later is at the limits
        value = amplitude * (math.sin(omega * k + phase) - math.sin(phase)) * min(k / 20.0, 1.0) / 2
        gate.measured(0, value, t * CYCLE_S)
        verdict = gate.pass_frame(t * CYCLE_S, on(value + 1e-9 * k))
        assert verdict.ok, verdict.text


@given(late, st.floats(1.06, 3.0))
def test_a_motion_beyond_the_limits_is_refused_however_late_it_is_told(
    delays: list[tuple[float, int]], share: float
) -> None:
    gate = armed()
    value, passed = -90.0, 0.0
    for t in instants(delays):
        gate.measured(0, value, t * CYCLE_S)
        asked = value + min(passed + 20.0, share * 20.0)
        if not gate.pass_frame(t * CYCLE_S, on(asked)).ok:
            return
        value, passed = asked, asked - value
    raise AssertionError(f"{share} times velocity_max passed for {LAST_CYCLE} cycles")


@given(st.lists(st.tuples(st.floats(0.0, 0.6), st.floats(-30.0, 30.0)), max_size=50))
def test_what_passes_is_a_motion_that_the_drive_can_run_in_the_time_there_was(
    stream: list[tuple[float, float]],
) -> None:
    gate, t, value = armed(), 10.0, 0.0
    passed: list[tuple[float, float]] = []
    for gap, step in stream:
        t += gap
        gate.measured(0, value, t * CYCLE_S)
        if gate.pass_frame(t * CYCLE_S, on(value + step)).ok:
            value += step
            passed.append((t, value))
    for i, (begin, start) in enumerate(passed):
        for n, (end, there) in enumerate(passed[i + 1 :], start=1):
            assert n <= end - begin + 2.25
            assert abs(there - start) <= 21.0 * (end - begin + 2.25)


@given(st.lists(st.tuples(st.floats(0.0, 0.6), st.floats(-30.0, 30.0)), max_size=50))
def test_no_speed_setpoints_gather_more_speed_than_there_was_time_for(
    stream: list[tuple[float, float]],
) -> None:
    gate, t, value = armed("velocity"), 10.0, 0.0
    passed: list[tuple[float, float]] = []
    for gap, step in stream:
        t += gap
        gate.measured(0, 0.0, t * CYCLE_S)
        if gate.pass_frame(t * CYCLE_S, speed(value + step)).ok:
            value += step
            passed.append((t, value))
    for i, (begin, start) in enumerate(passed):
        for end, there in passed[i + 1 :]:
            change = 21.0 / CYCLE_S + 2.0**-8
            assert abs(there - start) <= change * (end - begin + 2.25)
