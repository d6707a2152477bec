"""The benchmark of proposed experiments begins with cases that are open."""

from benchmarks.next_experiment import CLEAR, EFFECTS, judge, open_case, quiet_record, record

from hil.configfile import load_rig

AXIS = load_rig("axis")
PAIR = ("viscous_friction", "transport_delay")


def test_a_lively_record_tells_two_apart_and_an_open_case_does_not():
    lively, _ = judge(record(quiet_record(AXIS, 1.0), AXIS, EFFECTS[PAIR[0]], 0), PAIR, EFFECTS)
    assert lively[PAIR[0]] > CLEAR
    case = open_case(AXIS, PAIR, PAIR[0], 0)
    assert case is not None
    share, before, fits = case
    assert share < 1.0
    assert max(before.values()) <= CLEAR
    assert set(fits) == set(PAIR)
