"""A bicycle whose wheels slip outwards in bends: what it feels of that, against gravity on one that leans."""

from dataclasses import replace

import numpy as np
import pytest

from hil.bicycle.aside import goes_aside
from hil.bicycle.effects import differenced
from hil.configfile import load_bicycle
from hil.rigs.bicycle import pack, ride

RIG = load_bicycle("bicycle")
DT_S = 0.01
T_S = np.arange(0.0, 4.0, DT_S)
PER_ACCEL = 1e-3
"""rad for each m/s² across."""


def ridden(lean_rad: float):
    """Straight ahead at 5 m/s, leant so far."""
    angle = np.zeros((len(T_S), 3))
    angle[:, 0] = lean_rad
    angle[:, 1] = 5.0 / RIG.geometry.R * T_S
    return ride(pack(RIG), differenced(DT_S, angle))


@pytest.mark.parametrize("lean_rad", [0.03, -0.03])
def test_going_aside_feels_like_gravity_does_to_who_leans(lean_rad):
    """An acceleration of g tan(lean) to the left, on a bicycle that stands upright."""
    leans, upright = ridden(lean_rad), ridden(0.0)
    to_left = RIG.mass.gravity * np.tan(lean_rad)
    turns = upright.qd.copy()
    turns[:, 2] = -to_left / (PER_ACCEL * upright.speed**2) * T_S
    turning = replace(upright, qd=turns)
    found = goes_aside(turning, pack(RIG), PER_ACCEL)
    inside = slice(50, -50)
    torque = (found.lean_torque - upright.lean_torque)[inside]
    assert torque == pytest.approx((leans.lean_torque - upright.lean_torque)[inside], rel=0.03)
    felt = (found.imu - upright.imu)[inside, 4]
    assert felt == pytest.approx((leans.imu - upright.imu)[inside, 4], rel=0.01)
    assert np.array_equal(found.imu[:, :3], upright.imu[:, :3])  # it turns as it did


def test_it_follows_a_bend_late_by_slip_times_speed():
    """A slalom of 0.4 Hz: what is felt across is that of a slip's time before."""
    straight = ridden(0.0)
    turns = straight.qd.copy()
    turns[:, 2] = 0.4 * np.sin(2.0 * np.pi * 0.4 * T_S)
    turning = replace(straight, qd=turns)
    across = turning.speed * turns[:, 2]
    late_s = PER_ACCEL * float(np.mean(turning.speed))
    added = (goes_aside(turning, pack(RIG), PER_ACCEL).imu - turning.imu)[:, 4]
    told = np.interp(T_S - late_s, T_S, across) - across
    assert added[20:-20] == pytest.approx(told[20:-20], abs=0.02 * np.max(np.abs(told)))


def test_thin_wheels_go_where_they_point():
    assert goes_aside(ridden(0.02), pack(RIG), 0.0).imu == pytest.approx(ridden(0.02).imu)
