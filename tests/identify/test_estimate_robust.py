"""Intervals of a least-squares fit hold where residuals are alike over time, and where signals disagree."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from hil.identify.estimate.robust import contradictions, sandwich

SAMPLES, PERIOD_S = 3000, 0.02


def coloured(rng: np.random.Generator, size: int, memory: float) -> np.ndarray:
    return lfilter([np.sqrt(1.0 - memory**2)], [1.0, -memory], rng.standard_normal(size))


def fitted(slopes: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(parameters, residuals predicted less measured, as the twin has them)."""
    found, *_ = np.linalg.lstsq(slopes, y, rcond=None)
    return found, slopes @ found - y


def within(memory: float) -> tuple[float, float]:
    """Share of 95 % intervals with the truth: by the sandwich, and by counting samples."""
    inside = np.zeros((200, 2, 2), dtype=bool)
    for seed in range(200):
        rng = np.random.default_rng(seed)
        slopes = np.stack([coloured(rng, SAMPLES, 0.9), coloured(rng, SAMPLES, 0.9)], axis=1)
        truth = rng.standard_normal(2)
        found, residual = fitted(slopes, slopes @ truth + coloured(rng, SAMPLES, memory))
        times_s = PERIOD_S * np.arange(SAMPLES)
        plain = np.linalg.inv(slopes.T @ slopes) * np.mean(residual**2)
        for k, covariance in enumerate((sandwich(slopes, residual, times_s), plain)):
            inside[seed, k] = np.abs(found - truth) < 1.96 * np.sqrt(np.diag(covariance))
    return float(inside[:, 0].mean()), float(inside[:, 1].mean())


def test_the_interval_holds_where_residuals_are_alike_over_time():
    robust, plain = within(0.95)
    assert plain < 0.7
    assert robust == pytest.approx(0.95, abs=0.04)


def test_it_is_hardly_wider_where_they_are_not():
    robust, plain = within(0.0)
    assert plain == pytest.approx(0.95, abs=0.04)
    assert 0.94 < robust < 0.99


def two_kinds(rng: np.random.Generator, apart: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Two signals of which the second, less exact, is of a rig with another second parameter."""
    slopes = rng.standard_normal((2 * SAMPLES, 2))
    slopes[SAMPLES:] *= 0.5
    truth = np.tile([1.0, 2.0], (2 * SAMPLES, 1))
    truth[SAMPLES:, 1] += apart
    found, residual = fitted(
        slopes, np.sum(slopes * truth, axis=1) + rng.standard_normal(len(slopes))
    )
    return found, slopes, residual


def kinds() -> dict[str, np.ndarray]:
    second = np.arange(2 * SAMPLES) >= SAMPLES
    return {"position": ~second, "force": second}


def test_what_signals_say_apart_is_named_and_the_interval_takes_it_in():
    found, slopes, residual = two_kinds(np.random.default_rng(1), 3.0)
    times_s = np.tile(PERIOD_S * np.arange(SAMPLES), 2)
    more, (torn,) = contradictions(slopes, residual, times_s, kinds())
    assert torn.parameter == 1
    assert found[1] + torn.steps["position"] == pytest.approx(2.0, abs=0.1)
    assert found[1] + torn.steps["force"] == pytest.approx(5.0, abs=0.5)
    assert more[0] == 0.0
    assert np.sqrt(more[1]) == pytest.approx(3.0 / np.sqrt(2.0), rel=0.2)


def test_signals_that_agree_hardly_ever_seem_to_contradict_each_other():
    times_s = np.tile(PERIOD_S * np.arange(SAMPLES), 2)
    alarms = 0
    for seed in range(100):
        _, slopes, residual = two_kinds(np.random.default_rng(seed), 0.0)
        alarms += len(contradictions(slopes, residual, times_s, kinds())[1])
    assert alarms <= 3  # of 200


def test_one_kind_of_signal_contradicts_nobody():
    slopes, times_s = np.ones((50, 1)), PERIOD_S * np.arange(50)
    more, found = contradictions(slopes, np.ones(50), times_s, {"force": np.ones(50, dtype=bool)})
    assert found == ()
    assert more.tolist() == [0.0]


def test_a_parameter_that_nothing_depends_on_has_an_infinite_variance():
    rng = np.random.default_rng(0)
    slopes = np.stack([rng.standard_normal(200), np.zeros(200)], axis=1)
    covariance = sandwich(slopes, rng.standard_normal(200), PERIOD_S * np.arange(200))
    assert covariance[1, 1] == pytest.approx(1e16)
    assert covariance[0, 0] < 0.02
