"""A wheel that is out of round is read from the pitch rate, once a turn; what beats otherwise is not."""

from __future__ import annotations

import numpy as np
import pytest

from hil.bicycle.recorded import Ride
from hil.configfile import load_bicycle
from hil.gap.bicycle.roundness import runs_out_m

RIG = load_bicycle("bicycle")


def ride(size_m: float, order: float = 1.0, turned_rad: float = 0.0, seed: int = 1) -> Ride:
    """30 s at 3 to 5 m/s, on a wheel that lifts its end by `size_m` so often a turn; the IMU turned."""
    rng, dt_s = np.random.default_rng(seed), 1.0 / RIG.rate
    t = dt_s * np.arange(round(30.0 / dt_s))
    rate = (4.0 + np.sin(0.5 * t)) / RIG.geometry.R
    turned = np.cumsum(rate) * dt_s
    at = 0.005 * np.arange(round(29.9 / 0.005))
    angle, speed = np.interp(at, t, turned), np.interp(at, t, rate)
    lift = size_m * order * speed * np.cos(order * angle + 0.4)
    pitch = (
        lift / RIG.geometry.wheelbase + 0.004 * np.sin(1.3 * at) + 0.003 * rng.normal(size=len(at))
    )
    imu = {
        "imu.gyro_x": (at, np.sin(turned_rad) * pitch),
        "imu.gyro_y": (at, np.cos(turned_rad) * pitch),
        "imu.gyro_z": (at, np.zeros(len(at))),
    }
    rig = RIG.model_copy(
        update={"imu": RIG.imu.model_copy(update={"orientation": (0.0, 0.0, turned_rad)})}
    )
    angles = np.column_stack([np.zeros(len(t)), turned, np.zeros(len(t))])
    return Ride("ride", rig, 0.0, dt_s, angles, imu, ())


@pytest.mark.parametrize(("order", "turned_rad"), [(1.0, 0.0), (1.01, 0.0), (1.0, 0.7)])
def test_a_wheel_that_is_out_of_round_is_told_in_millimetres(order, turned_rad):
    rides = [ride(0.002, order, turned_rad, seed) for seed in (1, 2)]
    assert runs_out_m(rides) == pytest.approx(0.002, rel=0.1)


@pytest.mark.parametrize(
    ("size_m", "order"), [(0.0, 1.0), (0.0006, 1.0), (0.004, 0.5), (0.004, 1.12)]
)
def test_wheels_as_round_as_any_and_other_beats_are_none(size_m, order):
    assert runs_out_m([ride(size_m, order)]) is None


def test_every_ride_that_can_tell_must_say_so():
    without = ride(0.002)
    del without.imu["imu.gyro_y"]
    assert runs_out_m([ride(0.002), without]) == pytest.approx(0.002, rel=0.1)
    assert runs_out_m([without]) is None
    assert runs_out_m([ride(0.002), ride(0.0)]) is None
