"""Least squares, instruments and the adaptive law on experiments whose truth is known."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from hil.config import RigFile
from hil.configfile import load_rig
from hil.errors import IdentificationError
from hil.identify.estimate.adaptive import AdaptiveGradient, adapt, stability_bound_s
from hil.identify.estimate.calibration import simulated, unexplained
from hil.identify.estimate.fit import LinearOptions, body_numbers, identify_linear
from hil.identify.estimate.linear import long_run
from hil.identify.estimate.prepare import prepare
from hil.identify.estimate.regression import Regression, regression
from hil.identify.estimate.result import Identification
from hil.identify.estimate.stamps import placed
from hil.identify.replay import Stretch
from hil.sim.twin import Payload
from tests.identify.estimate_data import multisine, play, play_on_bus, without_noise

FRICTION = {"leg1.coulomb": 40.0, "leg2.viscous": 260.0}
TRUTH = {"mass.m": 212.0, "mass.inertia.xx": 21.0, "mass.inertia.zz": 36.0, **FRICTION}
CUTOFF = 8.0


@pytest.fixture(scope="module")
def motorcycle() -> RigFile:
    return load_rig("motorcycle")


@pytest.fixture(scope="module")
def ridden(motorcycle: RigFile) -> Stretch:
    return play(motorcycle, multisine(motorcycle, 12.0, 1, 3.0), truth=TRUTH, seed=5)


@pytest.fixture(scope="module")
def noiseless(motorcycle: RigFile) -> Regression:
    quiet = without_noise(motorcycle)
    piece = play(quiet, multisine(quiet, 6.0, 3, 3.0))
    return regression(quiet, [prepare(piece, quiet, CUTOFF)], CUTOFF)


def _deviations(result: Identification, truth: dict[str, float]) -> np.ndarray:
    """Distance of each estimate from the truth in its own standard deviations."""
    return np.array([(e.value - truth.get(e.name, e.nominal)) / e.std for e in result.estimates])


def test_mass_inertia_and_friction_are_found_with_intervals_that_hold_the_truth(
    motorcycle: RigFile, ridden: Stretch
) -> None:
    result = identify_linear([ridden], motorcycle, LinearOptions(draws=3)).identification
    z = _deviations(result, TRUTH)
    assert result.method == "iv"
    assert np.abs(z).max() < 3.0
    assert np.sum(np.abs(z) < 2.0) >= 8
    assert all(e.identifiable for e in result.estimates)
    for name, tolerance in (("mass.m", 0.005), ("mass.inertia.xx", 0.05), ("leg1.coulomb", 0.06)):
        assert result[name].value == pytest.approx(TRUTH[name], rel=tolerance)


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_frames_of_a_bus_shift_neither_mass_nor_friction(seed: int) -> None:
    axis = load_rig("axis")
    piece = play_on_bus(axis, multisine(axis, 20.0, seed, 3.0), late_s=2e-5, seed=seed)
    result = identify_linear(placed(axis, [piece]), axis, LinearOptions(draws=4)).identification
    assert np.abs(_deviations(result, {})).max() < 3.0
    assert result["mass.m"].value == pytest.approx(95.0, abs=0.6)
    assert result["axis.viscous"].value == pytest.approx(120.0, abs=12.0)
    assert result["axis.viscous"].std < 6.0
    (note,) = (n for n in result.notes if n.startswith("corrected by the twin"))
    assert "axis.viscous" in note
    assert "%" not in note


def test_what_the_twin_cannot_explain_of_the_jumps_widens_what_it_corrected() -> None:
    axis = load_rig("axis")
    right = play_on_bus(axis, multisine(axis, 10.0, 1, 3.0), late_s=0.0, seed=1)
    wrong = dataclasses.replace(  # frames that came anywhere within half a millisecond
        right,
        setpoints={
            a: (t + np.random.default_rng(0).uniform(0.0, 5e-4, len(t)), x)
            for a, (t, x) in right.setpoints.items()
        },
    )
    share = [
        unexplained(axis, pieces, simulated(axis, pieces, {}))
        for pieces in (placed(axis, [right]), [wrong])
    ]
    assert share[0] < 0.005
    assert share[1] > 0.1
    viscous = [
        identify_linear(pieces, axis, LinearOptions(draws=1)).identification["axis.viscous"]
        for pieces in (placed(axis, [right]), [wrong])
    ]
    assert viscous[1].std > 3.0 * viscous[0].std
    assert viscous[1].ci95[0] < 120.0 < viscous[1].ci95[1]


def test_ten_body_parameters_give_centre_of_gravity_and_inertia(
    motorcycle: RigFile, ridden: Stretch
) -> None:
    options = LinearOptions(body="full", draws=3)
    result = identify_linear([ridden], motorcycle, options).identification
    found = body_numbers({e.name: e.value for e in result.estimates})
    assert found["mass.cog.z"] == pytest.approx(0.4, abs=0.05)
    assert result["mass.origin_inertia.xx"].value == pytest.approx(21.0 + 212.0 * 0.16, rel=0.02)
    # m, m cx and I_yy come apart only by large pitch angles: the data must own up to that
    weak = result["mass.first_moment.x"]
    assert not weak.identifiable
    assert "apart from mass.m" in weak.reason or "mass.origin_inertia.yy" in weak.reason
    assert abs(weak.value + 212.0 * 0.4) < 3.0 * weak.std


def test_instruments_remove_the_bias_that_noise_makes_in_a_closed_loop(motorcycle: RigFile) -> None:
    noisy = motorcycle.model_copy(
        update={"noise": motorcycle.noise.model_copy(update={"position": 4e-4})}
    )
    piece = play(noisy, multisine(noisy, 20.0, 2, 3.0), seed=3)
    off = {
        method: identify_linear(
            [piece], noisy, LinearOptions(method=method, draws=2)
        ).identification
        for method in ("wls", "iv")
    }
    plain, instrumented = (off[m]["mass.inertia.zz"].value for m in ("wls", "iv"))
    assert plain < 0.85 * 40.0
    assert instrumented == pytest.approx(40.0, rel=0.12)


def test_covariance_counts_correlated_residuals() -> None:
    rng = np.random.default_rng(0)
    e = np.zeros(6000)
    for k in range(1, len(e)):
        e[k] = 0.8 * e[k - 1] + rng.normal()
    # variance of the sum of an AR(1): N sigma^2 / (1 - a)^2
    assert long_run(e[:, None], 40)[0, 0] / len(e) == pytest.approx(25.0, rel=0.25)


def test_the_adaptive_law_finds_the_parameters_of_data_without_noise(noiseless: Regression) -> None:
    truth = noiseless.nominal * np.linspace(0.8, 1.3, len(noiseless.columns))
    exact = dataclasses.replace(noiseless, y=noiseless.W @ truth)
    found = adapt(exact, np.ones(3), gain=30.0, passes=300)
    assert found.worst < 2.0
    assert found.values == pytest.approx(truth, rel=0.02)
    assert found.settled.max() < 1e-3


def test_the_plain_law_diverges_outside_its_bound_and_not_inside() -> None:
    rng = np.random.default_rng(1)
    Y = rng.normal(size=(400, 2, 3))
    p = np.array([1.0, -2.0, 0.5])
    bound = stability_bound_s(Y, np.full(3, 2.0))
    inside = AdaptiveGradient(np.zeros(3), np.full(3, 2.0), normalised=False)
    for row in Y:
        inside.update(row, row @ p, 0.9 * bound)
    assert inside.is_stable
    assert inside.values == pytest.approx(p, abs=1e-3)
    outside = AdaptiveGradient(np.zeros(3), np.full(3, 2.0), normalised=False)
    for row in Y:
        outside.update(row, row @ p, 12.0 * bound)
    assert not outside.is_stable
    assert np.abs(outside.values - p).max() > 1e3


def test_the_normalised_law_is_stable_at_any_gain() -> None:
    rng = np.random.default_rng(2)
    law = AdaptiveGradient(np.zeros(3), np.full(3, 1e6))
    p = np.array([3.0, 1.0, -1.0])
    for row in rng.normal(size=(600, 2, 3)):
        law.update(row, row @ p)
    assert law.is_stable
    assert law.values == pytest.approx(p, abs=1e-3)


def test_divergence_off_line_is_an_error_that_names_the_bound(noiseless: Regression) -> None:
    with pytest.raises(IdentificationError, match=r"diverges.*Take steps below"):
        adapt(noiseless, np.ones(3), dt_s=1.0)


def test_a_payload_is_refused_by_least_squares(motorcycle: RigFile, ridden: Stretch) -> None:
    loaded = dataclasses.replace(ridden, payload=Payload(20.0, (0.0, 0.0, 0.1)))
    with pytest.raises(IdentificationError, match="--method twin"):
        identify_linear([loaded], motorcycle, LinearOptions())
