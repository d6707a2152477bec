"""Setpoints act at the ticks of their drive's own clock."""

import numpy as np

from hil.gap.record.ticks import Ticks, acting
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
