"""Positions, speeds and accelerations of actuators and platform, for every kind of rig."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from numpy.typing import NDArray

from hil.config.rig import RigFile
from hil.configfile import load_rig
from hil.errors import KinematicsError
from hil.rigs import Manipulator, build_rig, solutions, stroke_violations
from hil.rigs.pack import kind_code, pack_body, pack_geometry, pack_gravity, pack_legs
from tests.rigs.models import STEP, Bodies
from tests.rigs.test_dynamics import state

RIGS = {name: build_rig(load_rig(name)) for name in ("axis", "motorcycle", "stewart", "simona")}


def shares(n: int) -> st.SearchStrategy[np.ndarray]:  # type: ignore[type-arg]
    return hnp.arrays(np.float64, n, elements=st.floats(-1.0, 1.0))


def check_round_trip(rig: Manipulator, share: np.ndarray) -> None:  # type: ignore[type-arg]
    q = share * rig.limits
    if stroke_violations(rig, q):  # no actuator can stand there
        return
    np.testing.assert_allclose(rig.forward(rig.inverse(q)), q, atol=1e-8)


@given(shares(3))
@settings(deadline=None)
def test_forward_undoes_inverse_on_the_motorcycle_platform(share: np.ndarray) -> None:  # type: ignore[type-arg]
    check_round_trip(RIGS["motorcycle"], share)


@given(shares(6))
@settings(deadline=None, max_examples=300)
def test_forward_undoes_inverse_on_the_stewart_platform(share: np.ndarray) -> None:  # type: ignore[type-arg]
    check_round_trip(RIGS["stewart"], share)


@given(shares(6))
@settings(deadline=None)
def test_forward_undoes_inverse_on_a_large_hexapod(share: np.ndarray) -> None:  # type: ignore[type-arg]
    check_round_trip(RIGS["simona"], share)


def ends_of_strokes(rig: Manipulator, farthest: float) -> list[NDArray[np.float64]]:
    """Poses where a stroke ends and poses on the way there, along random directions."""
    rng, poses = np.random.default_rng(1), []
    for _ in range(250):
        direction = rng.standard_normal(rig.n) * rig.limits
        direction /= np.max(np.abs(direction) / rig.limits)
        low, high = 0.0, farthest
        for _ in range(20):
            middle = 0.5 * (low + high)
            inside = not stroke_violations(rig, middle * direction)
            low, high = (middle, high) if inside else (low, middle)
        poses += [low * direction, rng.uniform() * low * direction]
    return poses


@pytest.mark.parametrize(
    ("name", "farthest"), [("motorcycle", 1.0), ("stewart", 4.0), ("simona", 4.0)]
)
def test_newton_needs_at_most_four_steps_anywhere_in_the_workspace(
    name: str, farthest: float
) -> None:
    """From neutral to 1e-6 m and rad: corners of the limits, and a hexapod's reach far beyond them.

    The motorcycle platform is held to its limits: rolled by 45 degrees its legs allow a second pose.
    """
    file, rig = load_rig(name), RIGS[name]
    arrays = (kind_code(file), pack_geometry(file), pack_body(file), pack_legs(file),
              pack_gravity(file))  # fmt: skip
    corners = np.stack(np.meshgrid(*[[-1.0, 1.0]] * rig.n), axis=-1).reshape(-1, rig.n)
    poses = [q for q in corners * rig.limits if not stroke_violations(rig, q)]
    poses += ends_of_strokes(rig, farthest)
    assert farthest == 1.0 or np.max(np.abs(poses) / rig.limits) > 1.5
    for q in poses:
        found = np.zeros(rig.n)
        solutions.forward_kinematics(*arrays, rig.inverse(q), found, 0.0, 4)
        np.testing.assert_allclose(found, q, atol=1e-6)


@pytest.mark.parametrize("name", ["motorcycle", "stewart"])
def test_forward_takes_up_a_guess(name: str) -> None:
    rig = RIGS[name]
    q = 0.5 * rig.limits
    np.testing.assert_allclose(rig.forward(rig.inverse(q), guess=q + 1e-4), q, atol=1e-9)


def test_positions_no_pose_can_have_are_named() -> None:
    with pytest.raises(KinematicsError, match=r"stewart: no pose found with leg1 0\.1000.*after"):
        RIGS["stewart"].forward([0.1, 5.0, 0.1, 5.0, 0.1, 5.0])


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_positions_that_are_no_numbers_give_no_pose(bad: float) -> None:
    for rig in RIGS.values():
        with pytest.raises(KinematicsError):
            rig.forward([bad] * rig.n)


def test_a_vector_of_the_wrong_length_is_refused() -> None:
    with pytest.raises(ValueError, match="motorcycle: needs 3 values, got shape"):
        RIGS["motorcycle"].inverse([0.0, 0.0])


def test_positions_are_the_distances_of_the_joints(heavy_file: RigFile) -> None:
    q, _, _ = state(heavy_file, 11)
    np.testing.assert_allclose(
        build_rig(heavy_file).inverse(q), Bodies(heavy_file).strokes(q), atol=1e-14
    )


def test_rates_are_the_derivatives_of_positions(heavy_file: RigFile) -> None:
    q, qd, _ = state(heavy_file, 12)
    exact = Bodies(heavy_file).strokes(q + 1j * STEP * qd).imag / STEP
    np.testing.assert_allclose(build_rig(heavy_file).rates(q, qd), exact, atol=1e-13)


def test_accelerations_are_the_derivatives_of_rates(heavy_file: RigFile) -> None:
    q, qd, qdd = state(heavy_file, 13)
    rig, dt = build_rig(heavy_file), 1e-6
    after = rig.rates(q + qd * dt + 0.5 * qdd * dt**2, qd + qdd * dt)
    before = rig.rates(q - qd * dt + 0.5 * qdd * dt**2, qd - qdd * dt)
    np.testing.assert_allclose(rig.accelerations(q, qd, qdd), (after - before) / 2 / dt, atol=1e-8)


def test_platform_motion_is_consistent_with_itself_and_the_closure(heavy_file: RigFile) -> None:
    q, qd, qdd = state(heavy_file, 14)
    rig, bodies, dt = build_rig(heavy_file), Bodies(heavy_file), 1e-6
    motion = rig.platform_motion(q, qd, qdd)
    R, origin = bodies.platform(q + 1j * STEP * qd)
    np.testing.assert_allclose(motion.R, np.real(R), atol=1e-14)
    np.testing.assert_allclose(motion.position, np.real(origin), atol=1e-14)
    np.testing.assert_allclose(motion.velocity, np.imag(origin) / STEP, atol=1e-13)
    spin = np.imag(R) / STEP @ np.real(R).T
    np.testing.assert_allclose(motion.omega, [spin[2, 1], spin[0, 2], spin[1, 0]], atol=1e-13)
    after = rig.platform_motion(q + qd * dt + 0.5 * qdd * dt**2, qd + qdd * dt, qdd)
    before = rig.platform_motion(q - qd * dt + 0.5 * qdd * dt**2, qd - qdd * dt, qdd)
    np.testing.assert_allclose(
        motion.acceleration, (after.velocity - before.velocity) / 2 / dt, atol=1e-8
    )
    np.testing.assert_allclose(motion.omega_dot, (after.omega - before.omega) / 2 / dt, atol=1e-8)


def test_the_rear_joint_stays_on_its_slide() -> None:
    """Closure (4) and (24), mended: P3 at x = -L, z = h for every pose, the origin in y = 0."""
    rig = RIGS["motorcycle"]
    for share in np.random.default_rng(2).uniform(-1, 1, (50, 3)):
        q = share * rig.limits
        motion = rig.platform_motion(q, q, q)
        p3 = motion.position + motion.R @ [-1.0, 0.0, -0.1]
        np.testing.assert_allclose(p3, [-1.0, rig.inverse(q)[2], 0.5], atol=1e-14)
        assert motion.position[1] == 0.0
