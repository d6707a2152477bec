"""The filter and the linear model: gain, phase, and agreement with the mechanism's inverse dynamics."""

from __future__ import annotations

import numpy as np
import pytest

from hil.configfile import load_rig
from hil.errors import IdentificationError
from hil.identify.estimate import linear
from hil.identify.estimate.body import force_rows
from hil.identify.estimate.filtering import ZeroPhaseFilter
from hil.identify.estimate.prepare import prepare
from hil.identify.estimate.regression import body_columns, regression
from hil.rigs import build_rig
from hil.rigs.pack import kind_code, pack_geometry, pack_gravity, pack_legs, pack_reflected
from tests.identify.estimate_data import multisine, play, without_noise

CUTOFF = 8.0


@pytest.mark.parametrize(("hz", "gain"), [(1.0, 1.0), (8.0, 0.5), (16.0, 1.0 / 17.0)])
def test_the_filter_has_its_gain_and_no_phase_on_uneven_samples(hz: float, gain: float) -> None:
    rng = np.random.default_rng(0)
    t = np.cumsum(rng.uniform(0.0099, 0.0101, 2000))
    smooth = ZeroPhaseFilter(CUTOFF).spline(t, np.sin(2 * np.pi * hz * t), "x")
    grid = np.arange(2.0, 18.0, 0.01)
    parts = np.stack([np.sin(2 * np.pi * hz * grid), np.cos(2 * np.pi * hz * grid)], axis=1)
    answer, *_ = np.linalg.lstsq(parts, smooth(grid - t[0]), rcond=None)
    assert answer[0] == pytest.approx(gain, abs=0.03)
    assert abs(answer[1]) < 0.01


def test_velocity_and_acceleration_are_those_of_the_signal() -> None:
    t = np.arange(0.0, 10.0, 0.02)
    smooth = ZeroPhaseFilter(CUTOFF).spline(t, 0.1 * np.sin(3.0 * t), "x")
    grid = np.arange(1.0, 9.0, 0.05)
    assert smooth.derivative(1)(grid) == pytest.approx(0.3 * np.cos(3.0 * grid), abs=2e-4)
    assert smooth.derivative(2)(grid) == pytest.approx(-0.9 * np.sin(3.0 * grid), abs=2e-3)


def test_a_signal_too_slow_for_the_cutoff_is_named() -> None:
    t = np.arange(0.0, 10.0, 0.1)
    with pytest.raises(IdentificationError, match=r"leg1\.force: is sampled 10\.0 times a second"):
        ZeroPhaseFilter(CUTOFF).spline(t, t, "leg1.force")


@pytest.mark.parametrize("name", ["axis", "motorcycle", "stewart"])
def test_the_regressor_gives_the_forces_of_inverse_dynamics(name: str) -> None:
    rig = load_rig(name)
    mechanism = build_rig(rig)
    rng = np.random.default_rng(1)
    n = mechanism.n
    q, rate, acc = (
        rng.uniform(-0.15, 0.15, (20, n)),
        rng.normal(0, 0.3, (20, n)),
        rng.normal(0, 1, (20, n)),
    )
    rho_dot = np.array([mechanism.rates(a, b) for a, b in zip(q, rate, strict=True)])
    rho_ddot = np.array(
        [mechanism.accelerations(a, b, c) for a, b, c in zip(q, rate, acc, strict=True)]
    )
    qd, qdd, W, own = np.zeros((20, n)), np.zeros((20, n)), np.empty((20, n, 10)), np.empty((20, n))
    singular = force_rows(
        kind_code(rig), pack_geometry(rig), pack_legs(rig), pack_gravity(rig),
        q, rho_dot, rho_ddot, qd, qdd, W, own,
    )  # fmt: skip
    columns, base, known = body_columns(rig, "principal")
    p = base @ np.array([c.nominal for c in columns]) + known
    expected = np.array(
        [mechanism.inverse_dynamics(a, b, c) for a, b, c in zip(q, rate, acc, strict=True)]
    )
    assert singular == -1
    assert qdd == pytest.approx(acc, abs=1e-12)
    assert W @ p + own + pack_reflected(rig) * rho_ddot == pytest.approx(expected, abs=1e-9)


def test_excited_in_all_coordinates_the_motorcycle_shows_all_ten_parameters() -> None:
    rig = without_noise(load_rig("motorcycle"))
    piece = play(rig, multisine(rig, 6.0, 3, 3.0))
    problem = regression(rig, [prepare(piece, rig, CUTOFF)], CUTOFF, body="full")
    body = (problem.W * problem.scale)[:, :, :10].reshape(-1, 10)
    singular = np.linalg.svd(body, compute_uv=False)
    assert singular[-1] > 1e-4 * singular[0]


def test_what_no_row_sees_stays_at_the_rig_file_with_an_infinite_variance() -> None:
    rig = without_noise(load_rig("motorcycle"))
    poses = multisine(rig, 6.0, 3, 3.0)
    poses[:, [0, 2]] = 0.0  # pitch alone
    problem = regression(rig, [prepare(play(rig, poses), rig, CUTOFF)], CUTOFF)
    problem.W[:, :, problem.names.index("mass.inertia.zz")] = 0.0
    fit = linear.ordinary(problem)
    k = problem.names.index("mass.inertia.zz")
    assert fit.values[k] == pytest.approx(40.0)
    assert fit.covariance[k, k] > 1e12
