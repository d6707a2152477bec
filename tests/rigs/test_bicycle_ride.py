"""A ride from its measured coordinates: forces, torques, path and IMU, against laws and published vectors."""

import numpy as np
import pytest
from scipy.optimize import brentq

from hil.config import BicycleFile
from hil.configfile import load_bicycle
from hil.errors import KinematicsError
from hil.rigs.bicycle import (
    Smooth,
    Whipple,
    impossible_bodies,
    low_pass,
    pack,
    reduced_inertia,
    ride,
    smooth,
    with_usual_rider,
)
from tests.rigs.bicycles import instant, text_bicycle

SPEED = 5.0 / 0.352


def test_at_rest_the_wheels_carry_the_weight():
    still = instant(text_bicycle(), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    rear, front = still.normal[0]
    assert front == pytest.approx(219.584, abs=1e-3)
    assert rear + front == pytest.approx(92.44 * 9.81, rel=1e-12)
    np.testing.assert_allclose(still.imu[0], [0.0, 0.0, 0.0, 0.0, 0.0, 9.81], atol=1e-12)


@pytest.mark.parametrize(
    ("on_frame", "speed", "gain", "front", "rear", "torque"),
    [
        (False, 5.0, 1.0, 166.1887, 740.6477, 37.66246),
        (False, 5.0, -3.0, 353.0788, 553.7576, -95.38738),
        (True, 0.0, 1.0, 141.153, 765.6834, 33.2625),
        (True, 5.0, -3.0, 444.0105, 462.8259, -95.3874),
    ],
)  # fmt: skip
def test_straight_line_loads_are_the_published_ones(on_frame, speed, gain, front, rear, torque):
    """With the encoder on the frame the torque is internal; from outside the load transfer would be wrong."""
    found = instant(
        text_bicycle(on_frame=on_frame),
        (0.0, 0.0, 0.0),
        (0.0, speed / 0.352, 0.0),
        (0.0, gain / 0.352, 0.0),
    )
    assert found.normal[0, 1] == pytest.approx(front, abs=1e-3)
    assert found.normal[0, 0] == pytest.approx(rear, abs=1e-3)
    assert found.drive_torque[0] == pytest.approx(torque, abs=1e-3)


def test_drive_torque_is_reduced_inertia_and_drag():
    rig = text_bicycle()
    assert reduced_inertia(rig) == pytest.approx(11.70838576, abs=1e-8)
    found = instant(rig, (0.0, 0.0, 0.0), (0.0, SPEED, 0.0), (0.0, 2.0, 0.0))
    expected = reduced_inertia(rig) * 2.0 + 0.5 * 25.0 * 0.352
    assert found.drive_torque[0] == pytest.approx(expected, rel=1e-12)


def test_load_transfer_follows_from_moments_about_the_rear_contact():
    rig = text_bicycle(aero=0.0)
    m, w, a = rig.mass, rig.geometry.wheelbase, 1.3
    found = instant(rig, (0.0, 0.0, 0.0), (0.0, SPEED, 0.0), (0.0, a / 0.352, 0.0))
    heights = np.array([0.352, m.G3[2] + 0.352, m.G4[2] + 0.352, 0.352])
    spun = (m.I2[1] + m.I5[1]) / 0.352
    expected = 219.584272 - a * (np.array(m.m) @ heights + spun) / w
    assert found.normal[0, 1] == pytest.approx(expected, abs=1e-5)


def test_steady_turn_is_the_published_one():
    rig = text_bicycle(on_frame=False)

    def lean_torque(lean):
        return instant(rig, (lean, 0.0, 0.1), (0.0, SPEED, 0.0)).multipliers[0, 6]

    lean = brentq(lean_torque, -0.4, -0.1, xtol=1e-13)
    found = instant(rig, (lean, 0.0, 0.1), (0.0, SPEED, 0.0))
    assert lean == pytest.approx(-0.228125524, abs=1e-9)
    assert found.q[0, 5] == pytest.approx(0.0015398541, abs=1e-10)
    assert found.q[0, 8] == pytest.approx(-0.0251841612, abs=1e-10)
    assert found.qd[0, 2] == pytest.approx(0.46445059, abs=1e-8)
    published = [
        -216.973546,
        0,
        -11.803369,
        -161.484056,
        4.856088,
        -49.458896,
        0,
        -4.154786,
        0.288468,
    ]
    np.testing.assert_allclose(found.multipliers[0], published, atol=1e-6)
    assert found.normal[0, 0] == pytest.approx(689.86285, abs=1e-5)
    assert 5.0 / found.qd[0, 2] == pytest.approx(10.7654, abs=1e-4)


def test_inverse_dynamics_returns_the_torques_of_forward_dynamics():
    rig = load_bicycle("bicycle")
    model = Whipple(rig)
    q = np.zeros(9)
    q[3], q[6] = -0.25, 0.2
    q = model.closed(q)
    qd = model.rates(q, 0.4, 11.0, -0.3)
    torques = (6.0, 17.0, -2.5)
    answer = model.respond(q, qd, *torques)
    qdd = answer.qdd
    found = instant(
        rig,
        (q[3], q[4] - q[5], q[6]),
        (qd[3], qd[4] - qd[5], qd[6]),
        (qdd[3], qdd[4] - qdd[5], qdd[6]),
    )
    mine = (found.lean_torque[0], found.drive_torque[0], found.steer_torque[0])
    np.testing.assert_allclose(mine, torques, rtol=1e-10)
    np.testing.assert_allclose(found.qdd[0, :9], qdd, atol=1e-9)
    np.testing.assert_allclose(
        found.multipliers[0, :6], answer.multipliers[:6], rtol=1e-9, atol=1e-9
    )


def u_turn(rate_hz, seconds=37.0):
    """Lean, wheel and steer of a smooth ride, at any rate the same one."""
    t = np.arange(round(seconds * rate_hz)) / rate_hz
    bend = np.exp(-0.5 * ((t - 10.0) / 1.6) ** 2) + np.exp(-0.5 * ((t - 26.0) / 1.6) ** 2)
    rolled = 14.0 * (t + 1.5 * np.exp(-t / 1.5) - 1.5)
    return np.column_stack([-0.22 * bend, rolled, 0.1 * bend])


def test_integration_at_100_hz_loses_no_millimetre():
    """Path drift comes from biases of the sensors, not from integration."""
    bicycle = pack(text_bicycle())
    coarse = ride(bicycle, smooth(u_turn(100.0), 0.01, None))
    fine = ride(bicycle, smooth(u_turn(1000.0), 0.001, None))
    np.testing.assert_allclose(coarse.q[-1, :2], fine.q[-10, :2], atol=1e-3)
    biased = u_turn(100.0)
    biased[:, 2] += np.deg2rad(0.15)
    off = ride(bicycle, smooth(biased, 0.01, None)).q[-1, :2] - coarse.q[-1, :2]
    assert np.linalg.norm(off) > 3.0, "one step of the steer encoder is metres"


def test_rolling_and_contact_hold_along_the_ride():
    rig = text_bicycle()
    found = ride(pack(rig), smooth(u_turn(100.0), 0.01))
    model = Whipple(rig)
    for k in (0, 500, 1000, 2600):
        assert np.abs(model.violation(found.q[k, :9], found.qd[k, :9])).max() < 1e-10
        np.testing.assert_allclose(model.closed(found.q[k, :9]), found.q[k, :9], atol=1e-12)
    assert np.abs(found.front_contact[:, 2]).max() < 1e-12


def test_the_imu_reads_its_own_motion():
    """Rate and specific force are derivatives of the sensor's orientation and place along the ride."""
    rig = load_bicycle("bicycle")
    imu = rig.imu.model_copy(update={"position": (0.3, 0.05, 0.6), "orientation": (0.2, -0.3, 1.0)})
    rig = rig.model_copy(update={"imu": imu})
    dt = 0.001
    found = ride(pack(rig), smooth(u_turn(1000.0), dt, None))
    where, axes = place_and_axes(rig, found.q)
    k = slice(9000, 11000)
    acceleration = np.gradient(np.gradient(where, dt, axis=0), dt, axis=0)
    acceleration[:, 2] += 9.81
    force = np.einsum("tji,tj->ti", axes, acceleration)
    turn = np.einsum("tji,tjk->tik", axes, np.gradient(axes, dt, axis=0))
    rate = np.stack([turn[:, 2, 1], turn[:, 0, 2], turn[:, 1, 0]], axis=1)
    np.testing.assert_allclose(found.imu[k, 3:], force[k], atol=2e-4)
    np.testing.assert_allclose(found.imu[k, :3], rate[k], atol=1e-6)


def place_and_axes(rig, q):
    from scipy.spatial.transform import Rotation

    lean = Rotation.from_euler("ZX", q[:, [2, 3]])
    frame = lean * Rotation.from_euler("Y", q[:, 5:6])
    centre = np.column_stack([q[:, 0], q[:, 1], np.zeros(len(q))]) + lean.apply(
        [0, 0, rig.geometry.R]
    )
    roll, pitch, yaw = rig.imu.orientation
    sensor = frame * Rotation.from_euler("ZYX", [yaw, pitch, roll])
    return centre + frame.apply(rig.imu.position), sensor.as_matrix()


def test_stiff_springs_are_the_rigid_bicycle_and_soft_ones_move():
    bicycle = pack(load_bicycle("bicycle"))
    measured = smooth(u_turn(100.0), 0.01)
    rigid = ride(bicycle, measured)
    stiff = ride(bicycle, measured, spring=(1e9, 1e10, 1e10), damper=(1e6, 1e6, 1e6))
    soft = ride(bicycle, measured, spring=(9e3, np.inf, np.inf), damper=(400.0, 0.0, 0.0))
    # the ride begins with a jerk, after which even a stiff spring rings for a moment
    np.testing.assert_allclose(stiff.imu[200:], rigid.imu[200:], atol=5e-3)
    assert np.abs(soft.imu[:, 1] - rigid.imu[:, 1]).max() > 0.01, "pitch rate shows the suspension"
    assert np.abs(soft.q[:, 10:]).max() == 0.0


def test_a_suspension_settles_where_its_spring_carries_the_load():
    """Constant braking: fork travel times stiffness is the load that the rigid bicycle puts on the fork."""
    rig = text_bicycle(aero=0.0)
    n, spring = 400, 2e4
    t = 0.01 * np.arange(n)
    angle = np.column_stack([np.zeros(n), SPEED * t - 0.5 * 4.0 * t**2, np.zeros(n)])
    rate = np.column_stack([np.zeros(n), SPEED - 4.0 * t, np.zeros(n)])
    pull = np.tile([0.0, -4.0, 0.0], (n, 1))
    told = Smooth(0.01, angle, rate, pull)
    found = ride(pack(rig), told, spring=(spring, np.inf, np.inf), damper=(1500.0, 0.0, 0.0))
    more = found.normal[-1, 1] - 219.584
    pushed = found.tangential[-1, 0, 0], found.tangential[-1, 1, 0]
    assert pushed[0] < 0.0
    # along the steer axis: extra normal force and what spins the front wheel down, less its own inertia
    axis = np.array([-np.sin(rig.geometry.tilt), np.cos(rig.geometry.tilt)])
    expected = axis @ [pushed[1] + rig.mass.m[3] * 4.0 * 0.352, more]
    assert spring * found.q[-1, 9] == pytest.approx(expected, rel=0.01)


def test_what_cannot_stand_is_named_with_its_time():
    told = Smooth(
        0.01, np.array([[0.0, 0.0, 0.0], [80.0, 0.0, 40.0]]), np.zeros((2, 3)), np.zeros((2, 3))
    )
    with pytest.raises(KinematicsError, match=r"0\.01 s .* degrees for radians"):
        ride(pack(load_bicycle("bicycle")), told)


def test_impossible_inertias_are_named_by_body():
    assert impossible_bodies(load_bicycle("bicycle")) == []
    said = impossible_bodies(load_bicycle("bicycle_text"))
    assert [s.split(":")[0] for s in said] == ["mass.I4", "mass.I5"]
    assert "handlebar and fork" in said[0]


def test_a_rider_who_cannot_be_a_part_of_body_3_is_named():
    bicycle = load_bicycle("bicycle")
    higher = bicycle.rider.model_copy(update={"height": 0.6})
    (said,) = impossible_bodies(bicycle.model_copy(update={"rider": higher}))
    # 40 of 85 kg at 1.1 m, 0.54 m above the whole: 9.2 - 1.9 - 40 * 85 / 45 * 0.54**2
    assert said.startswith("rider: ")
    assert "-15 kg·m²" in said


def test_a_usual_rider_is_one_that_the_frame_can_carry():
    bicycle = load_bicycle("bicycle")
    assert with_usual_rider(bicycle) is None  # it has one
    stiff = bicycle.model_copy(update={"rider": bicycle.rider.model_copy(update={"mass": 0.0})})
    assert with_usual_rider(stiff) is None  # its file says that he never leans
    ridden = with_usual_rider(BicycleFile.model_validate(bicycle.model_dump(exclude={"rider"})))
    assert ridden is not None
    assert ridden.rider.mass == pytest.approx(0.47 * 85.0, abs=0.1)
    assert impossible_bodies(ridden) == []
    assert with_usual_rider(load_bicycle("bicycle_delft")) is None  # nobody rides it


def test_conditioning_has_no_delay_and_half_gain_at_its_cutoff():
    t = 0.01 * np.arange(2000)
    wave = np.sin(2.0 * np.pi * 5.0 * t)
    through = low_pass(wave[:, None], 0.01, 5.0)[500:1500, 0]
    assert np.dot(through, wave[500:1500]) / np.dot(
        wave[500:1500], wave[500:1500]
    ) == pytest.approx(0.5, abs=1e-3)
    aside = np.dot(through, np.cos(2.0 * np.pi * 5.0 * t[500:1500])) / 500.0
    assert abs(aside) < 1e-3
