"""A wheel that creeps under what it drives with: what it turns, and what rolls of that."""

import numpy as np
import pytest

from hil.bicycle.creep import rolls, turns

RADIUS_M, CREEP, DT_S = 0.34, 0.008, 0.01
T_S = np.arange(0.0, 20.0, DT_S)


def ridden(hz: float) -> tuple[np.ndarray, np.ndarray]:
    """Rate (rad/s) and acceleration of a wheel that rolls faster and slower, by 2 m/s² at most."""
    w = 2.0 * np.pi * hz
    most = 2.0 / RADIUS_M
    return 15.0 + most / w * np.sin(w * T_S), most * np.cos(w * T_S)


@pytest.mark.parametrize("hz", [0.1, 0.5, 2.0])
def test_what_rolls_is_found_again_from_what_turns(hz):
    """At 2 Hz and 5 m/s it lags by a quarter of a radian: no first-order picture of that is enough."""
    rate, speeds_up = ridden(hz)
    drag = 0.1
    turned = turns(rate, RADIUS_M * speeds_up + drag, CREEP)
    turned_up = np.gradient(turned, DT_S)
    found = rolls(turned, turned_up, RADIUS_M * turned_up + drag, CREEP, RADIUS_M, DT_S)
    inside = slice(100, -100)
    assert np.max(np.abs(turned - rate)[inside]) > 20.0 * np.max(np.abs(found - rate)[inside])


def test_a_bicycle_that_speeds_up_by_itself_does_not_creep():
    """Swinging from side to side: its wheel turns faster and slower without any force."""
    rate, speeds_up = ridden(0.7)
    found = rolls(rate, speeds_up, np.zeros_like(rate), CREEP, RADIUS_M, DT_S)
    driven = rolls(rate, speeds_up, RADIUS_M * speeds_up, CREEP, RADIUS_M, DT_S)
    assert np.max(np.abs(found - rate)) < 0.02 * np.max(np.abs(driven - rate))


def test_a_wheel_that_does_not_turn_is_left_alone():
    still = np.zeros(50)
    assert not np.any(rolls(still, still, still, CREEP, RADIUS_M, DT_S))
