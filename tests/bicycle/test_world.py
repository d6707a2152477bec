"""The simulated ride obeys mechanics, and its sensors have the noise, steps and ranges of their file."""

import numpy as np
import pytest

from hil.bicycle.effects import RideEffects, differenced
from hil.bicycle.path import slalom
from hil.bicycle.simulated import save, simulate_ride
from hil.bicycle.world import STEP_S, ride_along
from hil.config import BicycleFile
from hil.configfile import load_bicycle
from hil.errors import RunError
from hil.rigs.bicycle import Whipple, pack
from hil.rigs.bicycle.forward import _row_at
from hil.runs import load_run


def test_the_ride_rolls_and_touches_the_road_throughout(round_trip):
    model = Whipple(round_trip.rig)
    truth = round_trip.truth
    for k in range(0, len(truth.t_s), 1500):
        q, qd = truth.q[k, :9], truth.qd[k, :9]
        assert np.abs(model.violation(q, qd)).max() < 1e-9
        np.testing.assert_allclose(model.closed(q), q, atol=1e-9)


def test_its_accelerations_are_those_of_the_model_under_its_torques(round_trip):
    """The forward simulation and the model of nine coordinates are assembled differently."""
    model = Whipple(round_trip.rig)
    truth = round_trip.truth
    for k in (5000, 16000, 18500, 30000):
        qdd = (truth.qd[k + 1] - truth.qd[k - 1]) / (2.0 * STEP_S)
        lean, drive, steer = truth.torques[k]
        expected = model.respond(truth.q[k, :9], truth.qd[k, :9], lean, drive, steer).qdd
        np.testing.assert_allclose(qdd[:9], expected, atol=0.02)


def test_work_of_the_rider_is_energy_and_drag(round_trip):
    model, truth = Whipple(round_trip.rig), round_trip.truth
    start, end = 2000, 20000
    q, qd, torques = truth.q, truth.qd, truth.torques
    drag = round_trip.rig.aero * np.hypot(*(qd[:, :2].T)) ** 3
    power = (
        torques[:, 1] * (qd[:, 4] - qd[:, 5]) + torques[:, 2] * qd[:, 6] + torques[:, 0] * qd[:, 3]
    )
    work = STEP_S * np.sum((power - drag)[start:end])
    gained = model.energy(q[end, :9], qd[end, :9]) - model.energy(q[start, :9], qd[start, :9])
    assert gained == pytest.approx(work, rel=0.02)


def test_sensors_have_the_noise_and_steps_of_the_file(round_trip):
    rig, table, truth = round_trip.rig, round_trip.table, round_trip.truth
    steer = table[["t", "steer"]].dropna()
    np.testing.assert_allclose(
        np.remainder(steer["steer"] / rig.noise.steer_step + 0.5, 1.0), 0.5, atol=1e-6
    )
    off = steer["steer"] - np.interp(steer["t"], truth.t_s, truth.q[:, 6])
    expected = np.hypot(rig.noise.steer, rig.noise.steer_step / np.sqrt(12.0))
    assert np.std(off) == pytest.approx(expected, rel=0.1)
    gyro = table[["t", "imu.gyro_z"]].dropna()
    off = gyro["imu.gyro_z"] - np.interp(gyro["t"], truth.t_s, truth.imu[:, 2])
    assert np.std(off) == pytest.approx(rig.noise.gyro, rel=0.1)
    assert 1.0 / np.median(np.diff(gyro["t"])) == pytest.approx(200.0, rel=1e-6)


def test_the_inclinometer_saturates_at_its_range():
    rig = load_bicycle("bicycle").model_dump()
    rig["sensors"]["lean_range"] = 0.05
    ride = simulate_ride(BicycleFile.model_validate(rig), slalom(60.0), seed=2)
    assert ride.table["lean"].abs().max() == pytest.approx(0.05)
    assert np.abs(ride.truth.q[:, 3]).max() > 0.08


def with_effect(effect, **parameters):
    rig = load_bicycle("bicycle").model_dump()
    rig["effects"] = [{"effect": effect, "location": "bicycle", "parameters": parameters}]
    return BicycleFile.model_validate(rig)


def test_a_fork_dives_under_the_brake_and_tyres_ring():
    diving = ride_along(with_effect("front_suspension", stiffness=8e3, damping=400.0), slalom(50.0))
    braking = diving.torques[:, 1] < -20.0
    assert diving.q[braking, 9].mean() > 0.003
    assert np.abs(diving.q[:, 10:]).max() < 1e-12, "the tyres are rigid"
    rough = ride_along(
        with_effect("tyre_compliance", stiffness=9e4, damping=200.0), slalom(50.0), road_m=0.002
    )
    smooth = ride_along(with_effect("tyre_compliance", stiffness=9e4, damping=200.0), slalom(50.0))
    assert rough.imu[8000:10000, 5].std() > 3.0 * smooth.imu[8000:10000, 5].std()


def test_a_rider_who_leans_needs_other_steer():
    still = ride_along(load_bicycle("bicycle"), slalom(50.0))
    leaning = ride_along(
        with_effect("rider_motion", stiffness=2000.0, damping=150.0, gain=0.3), slalom(50.0)
    )
    assert np.abs(leaning.rider_lean).max() > 0.01
    assert np.abs(still.rider_lean).max() == 0.0


def test_a_rider_swings_as_an_accelerometer_at_his_pivot_says():
    """A pendulum under the specific force and roll acceleration of a sensor that sits where he turns: it has
    gravity, the bend and, ahead of the rear wheel, yaw in it."""
    tables = with_effect("rider_motion", stiffness=600.0, damping=40.0).model_dump()
    tables["imu"]["position"] = tables["rider"]["pivot"]
    tables["imu"]["orientation"] = (0.0, 0.0, 0.0)
    rig = BicycleFile.model_validate(tables)
    truth = ride_along(rig, slalom(50.0))
    m, h = rig.rider.mass, rig.rider.height
    own = rig.rider.inertia + m * h * h
    swings = np.gradient(np.gradient(truth.rider_lean, STEP_S), STEP_S)
    held = 600.0 * truth.rider_lean + 40.0 * np.gradient(truth.rider_lean, STEP_S)
    across, up = truth.imu[:, 4], truth.imu[:, 5]
    rolls = np.gradient(truth.imu[:, 0], STEP_S)
    bends = m * h * (across + up * truth.rider_lean) - held - own * rolls
    inside = slice(2000, -2000)
    assert np.std((own * swings - bends)[inside]) < 0.06 * np.std(held[inside])


def test_a_rider_who_swings_is_all_the_lean_torque_that_is_left():
    """Of the rigid model under the ride's true motion: the world and the twin put him in apart."""
    rig = with_effect("rider_motion", stiffness=600.0, damping=40.0)
    truth = ride_along(rig, slalom(50.0))
    told = differenced(STEP_S * 20, truth.q[::20, [3, 4, 6]])
    effects = RideEffects.of(rig)
    motion = effects.motion(pack(rig), told)
    inside = (motion.speed > 3.0) & (np.abs(truth.torques[::20, 0]) < 1e-9)
    inside[:50] = inside[-50:] = False
    left = effects.lean_torque(rig, motion)[inside]
    rigid = motion.lean_torque[inside]
    assert np.std(left) < 0.15 * np.std(rigid)


def test_a_saved_ride_is_a_run_of_its_bicycle_without_its_secrets(weaving, tmp_path):
    folder = save(weaving, tmp_path / "ride", "a ride")
    run = load_run(folder)
    assert run.meta.mode == "ride"
    assert run.bicycle is not None
    assert run.bicycle.effects == ()
    assert list(run.table.columns) == list(weaving.table.columns)
    with pytest.raises(RunError, match="exists already"):
        save(weaving, folder)


def test_a_ride_that_the_disk_does_not_take_leaves_nothing_in_the_way(
    weaving, tmp_path, monkeypatch
):
    def full(table, path, **how):
        path.write_bytes(b"PAR1")
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("pandas.DataFrame.to_parquet", full)
    with pytest.raises(RunError, match="ride: cannot be written: No space left on device"):
        save(weaving, tmp_path / "ride")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("place", "row"), [(3.7, 3), (-2.0, 0), (1e300, 9), (np.inf, 9), (-np.inf, 0), (np.nan, 0)]
)
def test_a_rider_looks_at_his_plan_and_nowhere_else(place: float, row: int) -> None:
    """A ride that goes wild has places that are no numbers, and compiled code checks no index."""
    assert _row_at(place, np.zeros((10, 4))) == row
