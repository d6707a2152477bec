"""Periods at which ripple and errors of the lead may repeat themselves."""

from __future__ import annotations

import pytest

from hil.gap.catalogue.periods import with_turn
from tests.gap.twin_runs import AXIS

SCREW = AXIS.actuators[0]
LEAD_M = SCREW.motor_turn


def test_a_turn_of_the_motor_is_asked_for_where_the_travel_holds_one_and_no_period_is_like_it():
    assert with_turn([0.0053], SCREW, 0.012) == [0.0053, LEAD_M]
    assert with_turn([], SCREW, 0.4) == [LEAD_M]
    assert with_turn([0.02, 1.001 * LEAD_M], SCREW, 0.4) == [0.02, pytest.approx(1.001 * LEAD_M)]
    assert with_turn([0.0031], SCREW, 0.006) == [0.0031]


def test_a_rig_file_that_says_nothing_of_the_motor_asks_for_no_turn():
    assert with_turn([0.02], SCREW.model_copy(update={"transmission": None}), 0.4) == [0.02]
