"""Static poses give back the biases, scales and mounting that the sensors were made with."""

import numpy as np
import pandas as pd
import pytest

from hil.bicycle.calibration import calibrate, fit_accelerometer, straightened
from hil.configfile import load_bicycle, rig_toml
from hil.errors import IdentificationError
from hil.rigs.bicycle.parameters import rotation
from hil.signals import IMU_QUANTITIES
from tests.bicycle.rides import run_of
from tests.shared_data import shared

GYRO = np.array([0.011, -0.004, 0.007])
BIAS = np.array([0.12, -0.20, 0.06])
SCALE = np.array([1.01, 0.985, 1.004])
TILT = (0.02, -0.035, 0.0)
# frame's pose: roll, pitch, yaw
POSES = [
    (0, 0, 0),
    (1.4, 0, 0),
    (-1.4, 0.1, 1),
    (0, 1.2, 0),
    (0, -1.3, 2),
    (3.0, 0, 0),
    (0.8, 0.5, 0),
]


class Still:
    """A table like a simulated ride's, of poses held for three seconds each."""

    def __init__(self, poses, *, seed=0, moving=False):
        self.rig = load_bicycle("bicycle")
        rng = np.random.default_rng(seed)
        rows, t = [], 0.0
        sensor = rotation(*TILT)
        for pose in poses:
            down = (rotation(*pose) @ sensor).T @ [0.0, 0.0, 9.81]
            for _ in range(600):
                gyro = (
                    GYRO
                    + 0.004 * rng.standard_normal(3)
                    + (0.5 * np.sin(9.0 * t) if moving else 0.0)
                )
                accel = SCALE * down + BIAS + 0.08 * rng.standard_normal(3)
                lean = 0.013 + pose[0] + 0.002 * rng.standard_normal()
                rows.append([t, *gyro, *accel, np.clip(lean, -0.35, 0.35), -0.021])
                t += 0.005
        names = [f"imu.{q}" for q in IMU_QUANTITIES]
        self.table = pd.DataFrame(rows, columns=["t", *names, "lean", "steer"])


def test_ten_poses_give_everything_that_shows_at_rest():
    still = Still(POSES)
    found = calibrate([run_of(still)], still.rig)
    s = found.sensors
    assert len(found.poses) == len(POSES)
    assert s.lean_zero == pytest.approx(0.013, abs=5e-4)
    assert s.steer_zero == pytest.approx(-0.021, abs=1e-6)
    np.testing.assert_allclose(s.gyro_bias, GYRO, atol=3e-4)
    errors = np.concatenate([s.accel_bias - BIAS, s.accel_scale - SCALE, s.accel_cross])
    assert np.all(np.abs(errors) < 4.0 * np.array(found.accel_sd))
    np.testing.assert_allclose(s.accel_bias, BIAS, atol=0.02)
    np.testing.assert_allclose(found.orientation[:2], TILT[:2], atol=2e-3)
    assert found.residual < 0.02


def test_upright_alone_says_what_it_cannot_tell():
    still = Still(POSES[:1])
    found = calibrate([run_of(still)], still.rig)
    assert "1 poses of the 9" in found.notes[0]
    np.testing.assert_allclose(found.sensors.gyro_bias, GYRO, atol=5e-4)
    assert found.accel_sd[0] == pytest.approx(0.3, rel=0.05), "the prior: upright says nothing of x"


def test_the_calibrated_file_is_a_rig_file_with_provenance(tmp_path):
    still = Still(POSES)
    found = calibrate([run_of(still)], still.rig)
    path = tmp_path / "calibrated.toml"
    path.write_text(rig_toml(found.applied(still.rig)))
    read = load_bicycle(path)
    assert read.sensors == found.sensors
    assert read.imu.orientation == pytest.approx(found.orientation)
    assert "calibrate" in read.sensors.provenance


def test_nothing_at_rest_and_a_first_pose_that_lies_are_refused():
    moving = Still(POSES[:2], moving=True)
    with pytest.raises(IdentificationError, match="never rests"):
        calibrate([run_of(moving)], moving.rig)
    lying = Still([(1.4, 0, 0), (0, 0, 0)])
    with pytest.raises(IdentificationError, match="first pose must be upright"):
        calibrate([run_of(lying)], lying.rig)


def test_an_accelerometer_in_g_and_one_that_is_stamped_apart_are_refused():
    still = Still(POSES[:1])
    accel = [f"imu.accel_{a}" for a in "xyz"]
    still.table[accel] /= 9.81
    with pytest.raises(
        IdentificationError, match=r"feels 1\.0\d* m/s² and not gravity: is it in g"
    ):
        calibrate([run_of(still)], still.rig)
    still = Still(POSES[:1])
    still.table.loc[::2, accel] = np.nan
    still.table.loc[1::2, [f"imu.gyro_{a}" for a in "xyz"]] = np.nan
    with pytest.raises(
        IdentificationError, match=r"holds 0 instants with all of imu\.gyro_x, .* apart"
    ):
        calibrate([run_of(still)], still.rig)


@pytest.mark.shared
def test_a_real_accelerometer_in_many_poses():
    """An Xsens sensor held in poses: |a| comes to g within 2 mm/s2, only with bias, scale AND cross terms."""
    raw = np.loadtxt(shared("data/imu_xsens_calib/xsens_acc.txt.gz"))[:, 1:]
    counts = raw - 32768.0
    windows = [counts[i : i + 100] for i in range(0, len(counts) - 100, 100)]
    still = (
        9.81744 / 4078.0 * np.array([w.mean(axis=0) for w in windows if w.std(axis=0).max() < 12.0])
    )
    start = load_bicycle("bicycle").sensors
    found, sd, residual = fit_accelerometer(still, start, 9.81744, 1e-3)
    before = np.linalg.norm(still, axis=1) - 9.81744
    no_cross = straightened(still, np.concatenate([found[:6], np.zeros(3)]))
    assert len(still) > 300
    assert np.sqrt(np.mean(before**2)) > 0.5
    assert residual < 0.002
    assert np.std(np.linalg.norm(no_cross, axis=1)) > 5.0 * residual
    assert np.all(sd < 1e-3)


def test_a_steady_turn_is_no_pose_at_rest(round_trip):
    def moving(table):
        return table[(table["t"] > 3.0) & (table["t"] < 38.0)]

    with pytest.raises(IdentificationError, match="never rests"):
        calibrate([run_of(round_trip, moving)], round_trip.rig)


def test_a_ride_says_that_it_is_no_pose_and_what_of_it_was_used(round_trip):
    found = calibrate([run_of(round_trip)], round_trip.rig)
    used = sum(p.end_s - p.start_s for p in found.poses)
    (said,) = [n for n in found.notes if n.startswith("warning")]
    assert "ride is a ride at up to 5.0 m/s and no static pose" in said
    assert f"only the {used:.1f} s were used" in said
    still = Still(POSES)
    assert not any(n.startswith("warning") for n in calibrate([run_of(still)], still.rig).notes)


def test_a_first_pose_on_its_side_is_refused(round_trip):
    def on_its_side(table):
        names = {"imu.accel_y": "imu.accel_z", "imu.accel_z": "imu.accel_y"}
        return table[table["t"] < 1.3].rename(columns=names)

    with pytest.raises(IdentificationError, match="must be upright"):
        calibrate([run_of(round_trip, on_its_side)], round_trip.rig)
