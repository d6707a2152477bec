"""The schedule says what is due; a late caller never causes a burst."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hil.daemon.core.schedule import CYCLE, SYNC, Due, Schedule


def schedule():
    return Schedule(10.0, 0.01, 0.001, 3)


def slots(due):
    return [d.slot for d in due]


def test_a_cycle_begins_with_itself_and_the_first_slot():
    assert schedule().take(10.0) == [Due(CYCLE, 10.0), Due(0, 10.0)]


def test_slots_follow_a_stagger_apart():
    s = schedule()
    s.take(10.0)
    assert s.next_due_s == pytest.approx(10.001)
    assert slots(s.take(10.0011)) == [1]
    assert slots(s.take(10.0021)) == [2]
    assert s.next_due_s == pytest.approx(10.01)


def test_a_late_caller_gets_the_rest_of_the_cycle_at_once():
    s = schedule()
    assert slots(s.take(10.006)) == [CYCLE, 0, 1, 2]
    assert s.overruns == 0


def test_whole_cycles_gone_by_are_counted_and_skipped():
    s = schedule()
    s.take(10.005)
    assert slots(s.take(10.0455)) == [CYCLE, 0, 1, 2]
    assert s.overruns == 3
    assert s.missed_in_a_row == 3
    s.take(10.05)
    assert s.missed_in_a_row == 0


def test_an_unfinished_cycle_is_dropped_for_the_present_one():
    s = schedule()
    s.take(10.0)
    due = s.take(10.0201)
    assert slots(due) == [CYCLE, 0]
    assert due[0].due_s == pytest.approx(10.02)


def test_setpoints_that_come_after_the_next_sync_is_due_are_missed():
    s = Schedule(10.0, 0.01, 0.0, 2, synchronous=True)
    assert slots(s.take(10.009)) == [SYNC]
    assert slots(s.take(10.0101)) == [SYNC], "reading answers took until the next cycle"
    assert (s.cycles, s.overruns, s.missed_in_a_row) == (1, 1, 1)
    assert slots(s.take(10.0102)) == [CYCLE, 0, 1]
    assert slots(s.take(10.02)) == [SYNC]
    assert s.missed_in_a_row == 0


def test_slots_that_do_not_fit_are_refused():
    with pytest.raises(ValueError, match="do not fit"):
        Schedule(0.0, 0.01, 0.005, 3)


@given(st.lists(st.floats(0.0, 0.05), min_size=1, max_size=50))
def test_every_cycle_is_either_begun_or_counted_as_missed(steps):
    s = schedule()
    now_s = 10.0
    s.take(now_s)
    for step in steps:
        now_s += step
        due = s.take(now_s)
        assert slots(due).count(CYCLE) <= 1
        assert len(due) <= 4
        assert s.next_due_s > now_s
    assert (
        s.cycles + s.overruns == int((now_s - 10.0) / 0.01 + 1e-9) + 1
        or s.next_due_s - now_s < 1e-9
    )
