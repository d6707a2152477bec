"""What clients see of a record: what is known, by name, at a rate they asked for."""

import math
import random
from itertools import pairwise

import pytest

from hil.configfile import load_rig
from hil.daemon.gateway.state import Decimator, state_message
from hil.daemon.records import ActuatorState, StateRecord


@pytest.mark.parametrize("cycle_s", [0.001, 0.002, 0.003, 0.01, 0.02])
@pytest.mark.parametrize("jitter", [0.0, 0.1])
def test_no_more_than_the_rate_passes_and_hardly_less(cycle_s, jitter):
    random.seed(1)
    decimator = Decimator(100.0)
    t_s = [k * cycle_s + random.uniform(0.0, jitter * cycle_s) for k in range(int(10 / cycle_s))]
    passed = [t for t in t_s if decimator.lets(t)]
    wanted = min(100.0, 1 / cycle_s)
    assert 0.97 * wanted <= len(passed) / 10.0 <= wanted + 0.2
    assert min(b - a for a, b in pairwise(passed)) > 0.0049


def test_a_pause_or_a_clock_that_was_set_costs_nothing():
    decimator = Decimator(100.0)
    assert decimator.lets(5.0)
    assert not decimator.lets(5.002)
    assert decimator.lets(9.0)
    assert not decimator.lets(9.004)
    assert decimator.lets(1.0)
    assert not decimator.lets(1.004)


def test_what_is_not_known_is_left_out():
    rig = load_rig("motorcycle")
    nan = math.nan
    record = StateRecord(1.0, "preparing", (nan, 0.1, nan), (nan,) * 3, (ActuatorState(),) * 3)
    message = state_message(record, rig)
    assert message.pose == {"pitch": 0.1}
    assert message.setpoint == {}
    assert message.actuators["leg1"].position is None
    assert message.tracking_error == message.bus_load == message.slot_use == 0.0
