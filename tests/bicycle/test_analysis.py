"""A ride is taken apart: what was computed is what happened, and the IMU that took no part agrees."""

import json

import numpy as np
import pytest

from hil.bicycle.analysis import analyse
from hil.bicycle.drift import STEER_STEP
from hil.bicycle.recorded import prepare
from hil.bicycle.simulated import simulate_ride
from hil.config import Effect
from hil.configfile import load_bicycle
from hil.runs import load_run
from hil.runs.importing.importer import import_run
from hil.runs.importing.mapfile import find_map
from hil.ui.report_data import view
from hil.ui.report_figures import time_figure
from hil.ui.report_summary import summary_lines
from tests.bicycle.rides import ride_of, run_of
from tests.shared_data import shared


@pytest.fixture(scope="module")
def analysis(round_trip):
    return analyse(ride_of(round_trip))


def at(analysis, ride, values):
    """`values` of the truth at the analysis' samples."""
    return np.interp(analysis.ride.t_s, ride.truth.t_s, values)


def test_the_path_is_the_one_ridden(analysis, round_trip):
    for k, limit in ((0, 0.6), (1, 0.6), (2, 0.03)):
        truth = at(analysis, round_trip, round_trip.truth.q[:, k])
        assert np.abs(analysis.motion.q[:, k] - truth).max() < limit


def test_torques_are_those_of_the_rider(analysis, round_trip):
    rolls = analysis.motion.speed > 2.2  # below, a foot is on the ground
    drive = at(analysis, round_trip, round_trip.truth.torques[:, 1])
    steer = at(analysis, round_trip, round_trip.truth.torques[:, 2])
    assert np.std((analysis.motion.drive_torque - drive)[rolls]) < 0.15 * np.std(drive)
    assert abs(np.mean((analysis.motion.steer_torque - steer)[rolls])) < 0.03
    foot = at(analysis, round_trip, round_trip.truth.torques[:, 0])
    assert np.abs(foot[rolls]).max() == 0.0
    assert abs(np.mean(analysis.motion.lean_torque[rolls])) < 1.0, "nobody leans on a free bicycle"


def test_the_imu_agrees_within_its_noise(analysis):
    by = {(c.signal, c.filtered): c for c in analysis.compared}
    for signal, share in (("imu.gyro_y", 0.99), ("imu.gyro_z", 0.999), ("imu.accel_x", 0.98)):
        assert by[signal, True].explained > share
        assert by[signal, True].rms < by[signal, False].rms
    assert by["imu.gyro_z", False].rms < 1.3 * 0.004
    assert by["imu.accel_z", True].explained > 0.8


def test_a_healthy_ride_leaves_what_noise_alone_leaves(analysis):
    for c in analysis.compared:
        assert c.rms == pytest.approx(c.floor, rel=0.15), c
    n = analysis.numbers()
    assert n["lean_torque_rms"] == pytest.approx(n["lean_torque_noise_rms"], rel=0.15)


def test_a_signal_below_its_noise_is_too_quiet_to_judge(analysis):
    quiet = [c.signal for c in analysis.compared if c.filtered and c.is_quiet]
    assert quiet == ["imu.accel_y"]


def test_a_front_suspension_shows_in_the_pitch_rate_and_soft_tyres_in_the_vertical(analysis):
    """The two gaps of the text."""
    plain = {c.signal: c.rms for c in analysis.compared if c.filtered}
    for effect, parameters, shows in (
        ("front_suspension", {"stiffness": 7e3, "damping": 300.0}, "imu.gyro_y"),
        ("tyre_compliance", {"stiffness": 6e4, "damping": 150.0}, "imu.accel_z"),
    ):
        rig = load_bicycle("bicycle").model_dump()
        rig["effects"] = [{"effect": effect, "location": "bicycle", "parameters": parameters}]
        ride = simulate_ride(type(load_bicycle("bicycle")).model_validate(rig), seed=4)
        found = {c.signal: c.rms for c in analyse(ride_of(ride)).compared if c.filtered}
        grown = {s: found[s] / plain[s] for s in found}
        assert grown[shows] > 1.5, (effect, grown)
        assert grown["imu.gyro_z"] < 1.3, "the yaw rate knows nothing of it"


def test_drift_is_told_by_its_causes(analysis):
    drift = analysis.drift
    assert np.hypot(*drift.integration) < 1e-3
    assert np.hypot(*drift.steer_step) > 1.0
    assert 0.05 < np.hypot(*drift.lean_degree) < np.hypot(*drift.steer_step)


def test_what_moves_the_end_of_a_path_is_no_less_true_of_a_bicycle_whose_fork_gives(
    analysis, round_trip
):
    fork = {"effect": "front_suspension", "location": "bicycle"}
    stiff = Effect(**fork, parameters={"stiffness": 9000.0, "damping": 400.0})
    forked = round_trip.rig.model_copy(update={"effects": (stiff,)})
    found = analyse(prepare(run_of(round_trip), forked)).drift
    assert np.hypot(*(found.end - analysis.drift.end)) > 0.02, "the path itself is another"
    for name in ("steer_step", "lean_degree", "radius_percent"):
        assert getattr(found, name) == pytest.approx(getattr(analysis.drift, name), rel=1e-6), name


def test_a_biased_steer_encoder_is_what_closes_the_path(round_trip):
    def bias(table):
        table["steer"] += 3.0 * STEER_STEP
        return table

    found = analyse(ride_of(round_trip, bias)).drift
    assert np.hypot(*found.end) > 5.0
    assert found.closing_steer == pytest.approx(-3.0 * STEER_STEP, rel=0.25)
    assert found.closing_gap < 2.0


def test_a_bicycle_that_stood_has_no_bias_that_closes_its_path(round_trip):
    def stand(table):
        for signal, angle in (("lean", 0.01), ("rear_wheel", 0.0), ("steer", 0.01)):
            table[signal] = table[signal].where(table[signal].isna(), angle)
        return table.drop(columns=[c for c in table if c.startswith("imu.")])

    found = analyse(ride_of(round_trip, stand)).drift
    assert np.hypot(*found.end) < 1e-3
    assert found.closing_steer is None


def test_numbers_are_json(analysis):
    numbers = analysis.numbers()
    assert json.loads(json.dumps(numbers))["samples"] == len(analysis.motion.q)
    assert numbers["normal_front"]["lowest"] > 0.0
    assert 0.1 < numbers["friction_demand_front"]["peak"] < 1.0


@pytest.mark.shared
def test_a_measured_ride_rolls_as_its_gyroscope_says(tmp_path):
    """The riderless bicycle of TU Delft on its treadmill: roll rate and lateral acceleration, never used."""
    log = shared("data/sbw_bicycle/logs/eigen_normal_sil6.5n2_5.4kph.log.gz")
    import_run(log, find_map("bicycle_delft"), tmp_path / "ride")
    run = load_run(tmp_path / "ride")
    found = analyse(prepare(run, run.bicycle))
    by = {c.signal: c for c in found.compared if c.filtered}
    assert by["imu.gyro_x"].correlation > 0.99
    assert by["imu.accel_y"].correlation > 0.7
    assert found.numbers()["normal_front"]["mean"] == pytest.approx(114.4, abs=1.0)
    assert {f.check for f in found.findings} == {"from_speed", "inertia"}


def test_the_run_report_of_a_ride_shows_what_the_bicycle_measures(weaving):
    run = run_of(weaving)
    titles = [axis.title.text for axis in time_figure(view(run)).select_yaxes()]
    for title in ("<b>angle</b><br>deg", "<b>rear wheel</b><br>rad", "<b>rate</b><br>rad/s"):
        assert title in titles
    assert "hil bicycle analyse" in summary_lines(run)[-1]
