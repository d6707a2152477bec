"""The demo ride moves what a rider feels, within every limit of the rig it is made for."""

import numpy as np
import pytest

from hil.configfile import load_rig
from hil.control.demo_ride import SHARE, DemoRide
from hil.rigs import build_rig

STEP_S = 2e-3
T = np.arange(-1.0, 62.0, STEP_S)


@pytest.fixture(params=["motorcycle", "axis", "stewart"])
def rig(request):
    return load_rig(request.param)


def derivatives(poses):
    """Pose and its first three derivatives by differences."""
    found = [poses]
    for _ in range(3):
        found.append(np.diff(found[-1], axis=0) / STEP_S)
    return found


def test_every_coordinate_keeps_its_share_of_every_limit(rig):
    bounds = (rig.limits, *rig.cue_limits())
    for values, limit in zip(derivatives(DemoRide(rig).poses(T)), bounds, strict=True):
        assert np.all(np.abs(values).max(axis=0) <= 1.01 * SHARE * np.array(limit))


def test_tighter_limits_make_a_gentler_ride(rig):
    slow = rig.model_copy(
        update={"cue": rig.cue.model_copy(update={"velocity": (0.02,) * len(rig.limits)})}
    )
    _, velocity, _, _ = derivatives(DemoRide(slow).poses(T))
    assert np.all(np.abs(velocity).max(axis=0) <= 1.01 * SHARE * 0.02)


def test_the_ride_begins_and_ends_neutral_and_at_rest(rig):
    ride = DemoRide(rig)
    outside = (T <= 0.0) | (ride.duration_s <= T)
    assert np.abs(ride.poses(T)[outside]).max() < 1e-12


def test_every_coordinate_moves_noticeably(rig):
    poses = DemoRide(rig).poses(T)
    assert np.all(np.abs(poses).max(axis=0) > 0.01)


def test_actuators_stay_inside_their_strokes_and_speeds(rig):
    manipulator = build_rig(rig)
    t_s = np.arange(0.0, 60.0, 0.05)
    ride = DemoRide(rig)
    poses = ride.poses(t_s)
    rates = (ride.poses(t_s + 1e-4) - ride.poses(t_s - 1e-4)) / 2e-4
    for pose, rate in zip(poses, rates, strict=True):
        for actuator, rho, rho_dot in zip(
            rig.actuators, manipulator.inverse(pose), manipulator.rates(pose, rate), strict=True
        ):
            low, high = actuator.stroke
            margin = rig.safety.stroke_margin
            assert low + margin < rho < high - margin
            assert abs(rho_dot) < 0.7 * actuator.velocity_max


def test_leaning_and_heading_agree_with_the_steady_turn_in_a_lane_change():
    """Yaw rate = g·lean/v: in the first lane change (4..9 s), as a rider at 25 m/s would have it."""
    ride = DemoRide(load_rig("motorcycle"))
    t_s = np.arange(4.0, 9.0, 1e-3)
    poses = ride.poses(t_s)
    yaw, roll = poses[:, 0], poses[:, 2]
    yaw_rate = np.gradient(yaw, t_s)
    gain = float(yaw_rate @ roll) / float(roll @ roll)
    assert np.abs(yaw_rate - gain * roll).max() < 1e-3 * np.abs(yaw_rate).max()
    assert 0.5 * 9.81 / 25 < gain < 2.5 * 9.81 / 25


def test_one_pose_is_a_row_of_many():
    ride = DemoRide(load_rig("motorcycle"))
    assert ride.pose(12.5) == tuple(ride.poses(np.array([12.5]))[0])
    assert len(ride.pose(0.0)) == len(ride.coordinates) == 3
