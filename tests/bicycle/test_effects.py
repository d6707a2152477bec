"""What a bicycle's file says it has, its analysis has: sensors, wheels, rider, fork and tyres."""

import numpy as np
import pytest

from hil.bicycle.analysis import analyse
from hil.bicycle.effects import RideEffects, soft_motion
from hil.bicycle.recorded import prepare
from hil.config import BicycleFile
from hil.configfile import load_bicycle
from hil.errors import ConfigError
from hil.rigs.bicycle import pack
from tests.bicycle.rides import run_of

NOMINAL = load_bicycle("bicycle")


def having(effect, location, **parameters):
    tables = NOMINAL.model_dump()
    tables["effects"] = [{"effect": effect, "location": location, "parameters": parameters}]
    return BicycleFile.model_validate(tables)


def analysed(ride, rig, spoil=None):
    return analyse(prepare(run_of(ride, spoil), rig))


@pytest.fixture(scope="module")
def plain(weaving):
    return analysed(weaving, NOMINAL)


@pytest.mark.parametrize(("signal", "offset"), [("lean", 0.03), ("steer", -0.02)])
def test_a_bias_that_the_file_knows_is_taken_out(weaving, plain, signal, offset):
    def spoil(table):
        table[signal] = table[signal] + offset
        return table

    found = analysed(weaving, having("sensor_bias", signal, offset=offset), spoil)
    np.testing.assert_allclose(found.motion.q, plain.motion.q, atol=1e-9)
    np.testing.assert_allclose(found.drift.end, plain.drift.end, atol=1e-6)


def test_a_scale_of_the_imu_that_the_file_knows_is_put_on_the_model(weaving, plain):
    def spoil(table):
        table["imu.gyro_z"] = 1.05 * table["imu.gyro_z"]
        return table

    def off(a):
        return next(c.rms for c in a.compared if c.signal == "imu.gyro_z" and c.filtered)

    rig = having("sensor_scale", "imu.gyro_z", scale=1.05)
    assert off(analysed(weaving, rig, spoil)) == pytest.approx(1.05 * off(plain), rel=1e-6)
    assert off(analysed(weaving, NOMINAL, spoil)) > 3.0 * off(plain)


def test_slip_shortens_the_way_and_the_drift_knows_it(weaving, plain):
    found = analysed(weaving, having("wheel_slip", "rear_wheel", coefficient=0.03))
    share = found.numbers()["distance_m"] / plain.numbers()["distance_m"]
    assert share == pytest.approx(0.97, abs=1e-3)
    # a percent of radius lengthens the way that is slipped, not that of a wheel which holds
    there, further = found.motion.q[-1, :2], found.drift.radius_percent
    assert np.hypot(*further) == pytest.approx(0.01 * np.hypot(*there), rel=0.3)


def test_wheels_scale_on_top_of_each_other():
    twice = pack(NOMINAL).scaled(1.02, 1.0, 0.03).scaled(1.01, 1.03)
    at_once = pack(NOMINAL).scaled(1.02 * 1.01, 1.03, 0.03)
    np.testing.assert_allclose(twice.p, at_once.p, rtol=1e-14)


def test_a_wheel_that_the_file_has_wrong_rolls_further_and_pitches_no_frame():
    nominal, higher = pack(NOMINAL), pack(NOMINAL).scaled(1.05)
    wrong = pack(NOMINAL).scaled(1.05, frame=0.0)
    moved = np.flatnonzero(wrong.p != nominal.p)
    assert len(moved) == 1
    assert wrong.p[moved] == pytest.approx(higher.p[moved])
    assert (higher.p != nominal.p).sum() == 2


def test_a_rider_who_leans_along_explains_lean_torque(weaving, plain):
    rig = having("rider_motion", "bicycle", gain=0.3)
    found = analysed(weaving, rig)
    np.testing.assert_array_equal(found.motion.lean_torque, plain.motion.lean_torque)
    told = found.lean_torque - plain.lean_torque
    m, h, g = rig.rider.mass, rig.rider.height, rig.mass.gravity
    slow = np.abs(plain.motion.qdd[:, 3]) < 0.05
    np.testing.assert_allclose(
        told[slow], 0.3 * m * h * g * plain.motion.q[slow, 3], atol=0.3 * 0.05 * 60.0
    )


def test_tyres_of_a_round_section_leave_less_of_the_weights_arm(weaving, plain):
    """By the height of a body on a circle of that radius: its slope over lean is the weight's lever."""
    rig, motion, section_m = NOMINAL, plain.motion, 0.015
    values = dict(RideEffects.of(rig).values) | {
        "bicycle.lean_torque.tyre_section.radius": section_m
    }
    told = RideEffects(values).lean_torque(rig, motion) - plain.lean_torque
    lean, above_m, d = motion.q[:, 3], 1.0, 1e-5

    def height(at: np.ndarray, round_m: float) -> np.ndarray:
        return (above_m - round_m) * np.cos(at) + round_m

    levers = [-(height(lean + d, r) - height(lean - d, r)) / (2.0 * d) for r in (0.0, section_m)]
    weight = sum(rig.mass.m) * rig.mass.gravity
    np.testing.assert_allclose(told, weight * (levers[0] - levers[1]), atol=1e-6 * weight)


def test_a_tyre_that_creeps_as_it_drives_goes_less_far_than_it_rolls(weaving, plain):
    """By a third of a per cent for each m/s² of the force between tyre and road."""
    ride = prepare(run_of(weaving), NOMINAL)
    told = soft_motion(NOMINAL, ride.dt_s, ride.angles)
    none = RideEffects.of(NOMINAL)
    creeping = RideEffects(dict(none.values) | {"rear_wheel.drive_slip.per_accel": 1 / 300.0})
    rolls, creeps = (x.motion(pack(NOMINAL), told) for x in (none, creeping))
    drive = creeps.tangential[:, 0, 0] / sum(NOMINAL.mass.m)
    inside = slice(300, -300)
    share = creeps.speed[inside] / rolls.speed[inside]
    np.testing.assert_allclose(share, 1.0 - drive[inside] / 300.0, atol=8e-5)
    assert np.ptp(share) > 2e-3


def test_springs_as_hard_as_stone_change_nothing(weaving, plain):
    rig = having("tyre_compliance", "bicycle", stiffness=1e10, damping=200.0)
    assert RideEffects.of(rig).gives_way
    assert not RideEffects.of(rig).rigid.gives_way
    found = analysed(weaving, rig)
    np.testing.assert_allclose(found.motion.imu, plain.motion.imu, atol=1e-4)


def test_an_effect_that_no_catalogue_has_is_refused(weaving):
    with pytest.raises(ConfigError, match="squeaking"):
        analysed(weaving, having("squeaking", "bicycle", loud=1.0))
