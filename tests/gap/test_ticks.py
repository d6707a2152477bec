"""Setpoints act at the ticks of their drive's own clock."""

import numpy as np
import pytest

from hil.bus.load import RECKONED_BITS
from hil.gap.record.arrivals import find_clocks
from hil.gap.record.problem import Problem
from hil.gap.record.ticks import Ticks, acting
from hil.identify.replay import Stretch
from hil.sim import Twin
from tests.gap.twin_runs import AXIS

SENT = np.arange(0.0, 1.0, 0.0101)
TICK = AXIS.bus.position_loop


def acts_s(ticks):
    """When setpoints take effect: the smooth twin adds the delay and half a tick."""
    return acting(AXIS, SENT, ticks) + AXIS.bus.setpoint_delay + 0.5 * TICK


def test_without_a_known_clock_setpoints_stay_where_they_were_sent():
    np.testing.assert_array_equal(acting(AXIS, SENT, None), SENT)


def test_each_acts_at_the_first_tick_after_its_arrival():
    phase_s = 0.0003
    acts = acts_s(Ticks(phase_s, 0.0, 0.0))
    beside = (acts - phase_s) / TICK
    np.testing.assert_allclose(beside, np.round(beside), atol=1e-6)
    wait = acts - (SENT + AXIS.bus.setpoint_delay)
    assert np.all(wait > -1e-9)
    assert np.all(wait < TICK + 1e-9)


def test_a_clock_that_runs_off_takes_its_ticks_along():
    slow = Ticks(0.0, 2e-4, 0.0)
    acts = acts_s(slow)
    beside = (acts - slow.place(SENT)) / TICK
    np.testing.assert_allclose(beside, np.round(beside), atol=2e-3)


@pytest.mark.parametrize("frames", [0, 1, 2])
def test_how_late_a_drives_own_clock_was_started_is_read_from_the_record(frames):
    rig = AXIS.model_copy(update={"bus": AXIS.bus.model_copy(update={"retimed": True})})
    sent = np.arange(0.0, 6.0, rig.bus.cycle)
    told = 0.05 * np.sin(2.0 * np.pi * 0.8 * sent) * np.clip(sent, 0.0, 1.0)
    late_s = frames * RECKONED_BITS / rig.can.bitrate
    answered = sent + rig.bus.answer_delay + 0.0012
    stamps = {"axis.position": answered[::2], "axis.force": answered[1::2]}
    answers = Twin(rig, smooth=True).replay({"axis": (sent + late_s, told)}, stamps)
    samples = {s: (t, answers[s]) for s, t in stamps.items()}
    problem = Problem(rig, [Stretch("late", {"axis": (sent, told)}, samples)])
    clocks = find_clocks(problem)
    assert clocks[0, "axis"].late_s == pytest.approx(late_s)
    left = problem.with_clocks(clocks).residual(problem.base)
    np.testing.assert_allclose(left, 0.0, atol=1e-6)
