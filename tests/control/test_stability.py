"""A bandwidth that the cycle and the delays cannot carry is refused, and rightly so."""

from __future__ import annotations

import re

import numpy as np
import pytest

from hil.configfile import load_rig
from hil.control.cascade import Cascade
from hil.control.computed_torque import ComputedTorque
from hil.control.placement import second_order_gains
from hil.control.stability import Loop, check_bandwidth, is_stable, loop_of
from hil.errors import ConfigError
from hil.rigs import build_rig
from tests.control.loop import ClosedLoop, chirp, with_control

RIG = load_rig("motorcycle")
MANIPULATOR = build_rig(RIG)
CONTROLLERS = {"cascade": Cascade, "computed_torque": ComputedTorque}


@pytest.mark.parametrize("name", ["axis", "motorcycle", "stewart", "stewart_pd", "simona"])
@pytest.mark.parametrize("mode", ["drive", "cascade", "computed_torque"])
def test_shipped_rigs_are_stable_in_every_mode(name, mode):
    rig = with_control(load_rig(name), mode=mode)
    check_bandwidth(rig, build_rig(rig))


@pytest.mark.parametrize("mode", ["cascade", "computed_torque"])
def test_the_refusal_names_a_bandwidth_that_would_do(mode):
    rig = with_control(RIG, mode=mode, bandwidth=400.0)
    with pytest.raises(ConfigError, match="not stable in mode") as refused:
        check_bandwidth(rig, MANIPULATOR)
    most = float(re.search(r"at most ([\d.]+)", str(refused.value))[1])
    assert 20.0 < most < 400.0
    assert is_stable(with_control(rig, bandwidth=0.98 * most), MANIPULATOR)
    assert not is_stable(with_control(rig, bandwidth=1.1 * most), MANIPULATOR)


def test_pole_placement_gives_the_poles_asked_for():
    k_p, k_d = second_order_gains(30.0, 0.7)
    poles = np.roots([1.0, k_d, k_p])
    assert np.abs(poles) == pytest.approx(30.0)
    assert -poles.real / 30.0 == pytest.approx(0.7)


def test_at_a_fast_cycle_the_loop_has_the_poles_placed():
    # The observer's poles are placed at 200 rad/s and beyond (Ackermann), so the slow pair is what
    # remains: 10 rad/s with damping 0.7 decays with 7 1/s.
    T = 1.0e-3
    poles = np.exp(-np.array([200.0, 220.0, 240.0]) * T)
    A = np.array([[1.0, T, T * T / 2], [0.0, 1.0, T], [0.0, 0.0, 1.0]])
    H = np.array([1.0, 0.0, 0.0])
    coefficients = np.poly(poles)
    characteristic = sum(c * np.linalg.matrix_power(A, 3 - k) for k, c in enumerate(coefficients))
    observability = np.array([H @ np.linalg.matrix_power(A, k) for k in range(3)])
    gain = np.linalg.inv(A) @ characteristic @ np.linalg.inv(observability) @ [0.0, 0.0, 1.0]
    loop = Loop("computed_torque", T, 0.0, 1, gain, 1.0)
    radius = loop.spectral_radius(second_order_gains(10.0, 0.7), 1.0)
    assert -np.log(radius) / T == pytest.approx(7.0, rel=0.02)


@pytest.mark.parametrize("mode", ["cascade", "computed_torque"])
def test_the_plant_agrees_on_what_is_stable(mode):
    def shake(bandwidth):
        rig = with_control(RIG, mode=mode, bandwidth=bandwidth)
        loop = ClosedLoop(rig, controller=CONTROLLERS[mode](rig, MANIPULATOR))
        loop.force = True
        loop.plant.reset(mode="off")
        for i in range(3):
            loop.plant.set_mode(i, "force")
        trace = loop.run(chirp([0.0, 0.005, 0.0], 0.3, 0.4, 4.0), 4.0)
        return float(np.std(np.diff(trace.setpoints[200:, 0])))

    calm = shake(RIG.control.bandwidth)
    wild = shake(400.0)
    assert wild > 20.0 * calm


def test_slow_modes_of_coupled_legs_are_known():
    share = loop_of(with_control(RIG, mode="cascade"), MANIPULATOR).slowest_share
    felt = MANIPULATOR.actuator_inertia(np.zeros(3))
    assert 0.0 < share < 1.0
    assert share == pytest.approx(
        np.min(np.linalg.eigvals(np.diag(np.diag(felt)) @ np.linalg.inv(felt)).real)
        / np.max(np.linalg.eigvals(np.diag(np.diag(felt)) @ np.linalg.inv(felt)).real)
    )
