"""What beats once a turn of a wheel is read from pitch rate and encoder; what beats otherwise is not."""

from __future__ import annotations

import re

import numpy as np
import pytest

from hil.bicycle.recorded import Ride
from hil.configfile import load_bicycle
from hil.gap.bicycle.roundness import once_a_turn

RIG = load_bicycle("bicycle")


def ride(
    size_m: float,
    order: float = 1.0,
    *,
    turned_rad: float = 0.0,
    ahead_rad: float = 0.0,
    seed: int = 1,
) -> Ride:
    """30 s at 3 to 5 m/s, on a wheel that lifts its end by `size_m` so often a turn; the IMU turned, the
    wheel's encoder ahead once a turn."""
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
    told = turned + ahead_rad * np.sin(turned + 1.1) + 0.001 * rng.normal(size=len(t))
    angles = np.column_stack([np.zeros(len(t)), told, np.zeros(len(t))])
    return Ride("ride", rig, 0.0, dt_s, angles, imu, ())


def size_of(text: str) -> float:
    """The number that `text` tells."""
    return float(re.search(r"by ([0-9.]+) m", text).group(1))


@pytest.mark.parametrize(("order", "turned_rad"), [(1.0, 0.0), (1.01, 0.0), (1.0, 0.7)])
def test_a_wheel_that_is_out_of_round_is_told_in_millimetres(order, turned_rad):
    told = once_a_turn([ride(0.002, order, turned_rad=turned_rad, seed=seed) for seed in (1, 2)])
    assert "out of round" in told
    assert size_of(told) == pytest.approx(2.0, rel=0.1)


def test_an_encoder_off_centre_is_told_in_milliradians():
    told = once_a_turn([ride(0.0, ahead_rad=0.006)])
    assert "encoder is off centre" in told
    assert size_of(told) == pytest.approx(6.0, rel=0.1)
    assert "out of round" in once_a_turn([ride(0.002, ahead_rad=0.006)])  # which makes the other


@pytest.mark.parametrize(
    ("size_m", "order", "ahead_rad"),
    [(0.0, 1.0, 0.0), (0.0006, 1.0, 0.0), (0.004, 0.5, 0.0), (0.004, 1.12, 0.0), (0.0, 1.0, 0.002)],
)
def test_wheels_as_true_as_any_and_other_beats_are_none(size_m, order, ahead_rad):
    assert once_a_turn([ride(size_m, order, ahead_rad=ahead_rad)]) is None


def test_every_ride_that_can_tell_must_say_so():
    without = ride(0.002)
    del without.imu["imu.gyro_y"]
    assert size_of(once_a_turn([ride(0.002), without])) == pytest.approx(2.0, rel=0.1)
    assert once_a_turn([without]) is None
    assert once_a_turn([ride(0.002), ride(0.0)]) is None
