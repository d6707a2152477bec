"""State now from samples that are late, staggered, lost or wild; checked on the simulated platform."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.linalg import solve_discrete_are

from hil.configfile import load_rig
from hil.control import Observer, Setpoints
from hil.control.observer import observer_parameters, position_variance
from hil.control.stability import loop_of
from hil.rigs import build_rig
from hil.signals import Sample
from tests.control.loop import ClosedLoop, chirp, still, with_control

RIG = load_rig("motorcycle")
AXIS = load_rig("axis")
MANIPULATOR = build_rig(RIG)
MOTION = chirp([0.02, 0.01, 0.02], 0.2, 2.0, 8.0)
MODES = ("drive", "cascade", "computed_torque")


def axis_observer():
    return Observer(AXIS, build_rig(AXIS))


def position(t, value, name="axis"):
    return Sample(name, "position", value, t, t + 0.001)


def feed(observer, times, path):
    for t in times:
        observer.sample(position(t, path(t)))


@pytest.mark.parametrize("mode", MODES)
def test_pose_and_rates_are_known_between_seldom_samples(mode):
    loop = ClosedLoop(with_control(RIG, mode=mode))
    trace = loop.run(MOTION, 8.0)
    moving = trace.t > 1.0
    pose_error = np.std((trace.observed - trace.pose)[moving], axis=0)
    rate_error = np.std((trace.observed_rates - trace.rates)[moving], axis=0)
    # The last sample as it stands is 10 to 20 ms old: that is what knowing nothing more costs.
    stale = np.std((trace.pose[2:] - trace.pose[:-2])[moving[2:]], axis=0)
    assert np.all(pose_error < 0.15 * stale)
    assert np.all(pose_error < 1.5e-4)
    assert np.all(rate_error < 0.1 * np.std(trace.rates[moving], axis=0))
    assert not loop.observer.counts


@pytest.mark.parametrize("mode", MODES)
def test_lost_samples_are_bridged(mode):
    loop = ClosedLoop(with_control(RIG, mode=mode))
    rng = np.random.default_rng(3)
    loop.lose = lambda t, i: rng.random() < 0.3
    trace = loop.run(MOTION, 8.0)
    error = (trace.observed - trace.pose)[trace.t > 1.0]
    assert np.all(np.std(error, axis=0) < 4e-4)
    assert np.abs(trace.error()).max() < 0.05


def test_wild_samples_are_not_believed_but_counted():
    loop = ClosedLoop(with_control(RIG, mode="computed_torque"))
    hits = []

    def wild(t, i, value):
        if i == 0 and int(t * 100) % 37 == 0:
            hits.append(t)
            return value + 0.02
        return value

    loop.change = wild
    trace = loop.run(MOTION, 8.0)
    assert len(hits) > 5
    assert loop.observer.counts["rejected:leg1"] == len(hits)
    assert np.all(np.std((trace.observed - trace.pose)[trace.t > 1.0], axis=0) < 2e-4)


def test_a_lasting_jump_is_believed_after_three_samples():
    observer = axis_observer()
    feed(observer, np.arange(0.0, 1.0, 0.02), lambda t: 0.0)
    seen = []
    for t in np.arange(1.0, 1.1, 0.02):
        observer.sample(position(t, 0.05))
        seen.append(observer.estimate(t).position[0])
    assert seen[0] == pytest.approx(0.0, abs=1e-4)
    assert seen[1] == pytest.approx(0.0, abs=1e-4)
    assert seen[2] == pytest.approx(0.05, abs=1e-4)
    assert observer.counts == {"rejected:axis": 3, "restarted:axis": 1}


def test_a_long_gap_restarts_from_the_next_sample():
    observer = axis_observer()
    feed(observer, np.arange(0.0, 1.0, 0.02), lambda t: 0.05 * t)
    observer.sample(position(2.0, 0.2))
    estimate = observer.estimate(2.0)
    assert estimate.position[0] == pytest.approx(0.2)
    assert estimate.velocity[0] == 0.0
    assert observer.counts == {"restarted:axis": 1}


def test_samples_older_than_one_already_used_are_dropped():
    observer = axis_observer()
    feed(observer, [0.0, 0.02, 0.04], lambda t: 0.0)
    before = observer.estimate(0.05)
    observer.sample(position(0.03, 0.0002))
    after = observer.estimate(0.05)
    assert after.position[0] == before.position[0]
    assert observer.counts == {"late:axis": 1}


@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_values_that_are_not_finite_never_enter(value):
    observer = axis_observer()
    feed(observer, [0.0, 0.02], lambda t: 0.1)
    observer.sample(position(0.04, value))
    assert np.isfinite(observer.estimate(0.05).position).all()
    assert observer.counts == {"not_finite:axis": 1}


def test_nothing_is_known_before_every_actuator_has_answered():
    observer = Observer(RIG, MANIPULATOR)
    rho = MANIPULATOR.inverse(np.array([0.02, 0.03, -0.01]))
    for i, name in enumerate(RIG.actuator_names):
        assert not observer.estimate(0.1).is_known
        observer.sample(position(0.05, rho[i], name))
    estimate = observer.estimate(0.05)
    assert estimate.is_known
    assert estimate.pose == pytest.approx([0.02, 0.03, -0.01], abs=1e-8)


def test_age_force_and_innovation_are_told():
    observer = axis_observer()
    feed(observer, [0.0, 0.02], lambda t: 0.1)
    observer.sample(Sample("axis", "force", 12.0, 0.03, 0.031))
    observer.sample(Sample("imu", "gyro_x", 1.0, 0.03, 0.031))
    estimate = observer.estimate(0.05)
    assert estimate.age_s[0] == pytest.approx(0.03)
    assert estimate.force[0] == 12.0
    observer.sample(position(0.06, 0.1001))
    assert observer.estimate(0.06).innovation[0] == pytest.approx(1e-4, rel=0.05)


def test_velocity_samples_are_used_too():
    observer = axis_observer()
    observer.applied(0.0, Setpoints(np.zeros(1), "force"))
    for k in range(50):
        t = 0.02 * k
        observer.sample(position(t, 0.05 * t))
        observer.sample(Sample("axis", "velocity", 0.05, t + 0.01, t + 0.011))
    assert observer.estimate(1.0).velocity[0] == pytest.approx(0.05, rel=0.02)


def test_unexplained_force_is_the_payload_the_model_lacks():
    rig = with_control(RIG, mode="computed_torque")
    heavy = rig.model_copy(update={"mass": rig.mass.model_copy(update={"m": 250.0})})
    loop = ClosedLoop(rig, heavy)
    loop.run(still(3), 4.0)
    estimate = loop.observer.estimate(4.01)
    missing = MANIPULATOR.static_forces(np.zeros(3)) - build_rig(heavy).static_forces(np.zeros(3))
    friction = np.array([a.coulomb for a in RIG.actuators])
    assert np.all(np.abs(estimate.disturbance - missing) < friction + 5.0)


def test_the_gain_is_that_of_the_riccati_equation():
    rig = with_control(RIG, mode="computed_torque")
    T, q = 0.02, observer_parameters(rig)[0, 5]
    A = np.array([[1.0, T, T * T / 2], [0.0, 1.0, T], [0.0, 0.0, 1.0]])
    H = np.array([[1.0, 0.0, 0.0]])
    Q = q * np.array(
        [
            [T**5 / 20, T**4 / 8, T**3 / 6],
            [T**4 / 8, T**3 / 3, T**2 / 2],
            [T**3 / 6, T**2 / 2, T],
        ]
    )
    R = position_variance(rig)
    P = solve_discrete_are(A.T, H.T, Q, np.array([[R]]))
    gain = P[:, 0] / (P[0, 0] + R)
    # The filter works in steps of 1 ms, the oracle in one of 20.
    assert loop_of(rig, MANIPULATOR).gain == pytest.approx(gain, rel=0.05)


def test_observer_poles_are_those_of_a_butterworth_filter():
    bus = RIG.bus.model_copy(update={"cycle": 0.0005, "pattern": ("position",), "stagger": 0.0})
    rig = with_control(RIG, mode="computed_torque").model_copy(update={"bus": bus})
    gain = loop_of(rig, MANIPULATOR).gain
    T = 0.0005
    A = np.array([[1.0, T, T * T / 2], [0.0, 1.0, T], [0.0, 0.0, 1.0]])
    poles = np.log(np.linalg.eigvals(A - np.outer(A @ gain, [1.0, 0.0, 0.0]))) / T
    w = rig.control.observer
    butterworth = w * np.exp(1j * np.pi * np.array([2 / 3, 1.0, 4 / 3]))
    for pole in butterworth:
        assert np.min(np.abs(poles - pole)) < 0.05 * w
