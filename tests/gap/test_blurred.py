"""Steps that noise blurs are found by what rounding explains; what moves evenly gathers at no grid."""

from __future__ import annotations

import numpy as np
import pytest

from hil.gap import diagnose
from hil.gap.floor import blurred
from hil.gap.floor.blurred import blurred_step
from tests.gap.twin_runs import AXIS, record

STEP = 2.6e-4
RNG = np.random.default_rng(5)
T_S = np.arange(3000) * 0.01
SMOOTH = 0.08 * np.sin(1.7 * T_S) + 0.03 * np.sin(5.1 * T_S + 0.4)
NOISE = 2.5e-5 * RNG.standard_normal(len(T_S))


@pytest.mark.parametrize("twin_off", [0.0, 4e-5])
def test_rounding_is_seen_through_noise_and_what_the_twin_lacks(twin_off):
    values = STEP * np.round(SMOOTH / STEP) + NOISE
    residual = values - SMOOTH + twin_off * np.sin(11.0 * T_S)
    assert blurred_step(values, residual, 2.5e-5, 6e-5) == pytest.approx(STEP, rel=1e-3)


def test_noise_another_gap_and_even_motion_gather_at_no_grid():
    assert blurred_step(SMOOTH + NOISE, NOISE, 2.5e-5, 6e-5) is None
    bent = 2e-4 * np.sin(2.0 * np.pi * SMOOTH / 0.005) + NOISE
    assert blurred_step(SMOOTH + bent, bent, 2.5e-5, 6e-5) is None
    stepping = SMOOTH + 0.5 * (
        STEP * np.round(SMOOTH / STEP) - SMOOTH
    )  # a rig that moves in steps, softly
    assert blurred_step(stepping + NOISE, stepping + NOISE - SMOOTH, 2.5e-5, 6e-5) is None
    rests = 0.1 * RNG.uniform(size=12)[RNG.integers(12, size=2700)]
    rested = np.concatenate([SMOOTH[:300], rests]) + NOISE
    assert blurred_step(rested, 2e-4 * np.sin(9.0 * T_S), 2.5e-5, 6e-5) is None
    even = 0.02 * T_S  # a step of 0.2 mm for each sample
    assert blurred_step(even + NOISE, NOISE + 5e-5 * np.sin(3.0 * T_S), 2.5e-5, 6e-5) is None


def test_lone_values_that_lie_on_a_grid_by_chance_are_no_steps(monkeypatch):
    """A force rests at two levels, and passes the others once each, where they happen to lie."""
    rng = np.random.default_rng(2)
    rests = np.concatenate(
        [1200.0 + rng.uniform(-40.0, 40.0, 550), 1550.0 + rng.uniform(-40.0, 40.0, 550)]
    )
    lone = 1075.0 + 25.0 * np.arange(24) + 1.5 * rng.standard_normal(24)
    values, residual = np.concatenate([rests, lone]), 20.0 * rng.standard_normal(1124)
    monkeypatch.setattr(blurred, "_nearest", lambda *a: 1.0 / 25.0)
    assert blurred._by_level(values, 1.0 / 25.0) > 0.5
    assert blurred_step(values, residual, 4.0, 10.0) is None


def test_an_encoder_that_rounds_before_its_noise_is_named():
    frame = record()
    told = frame["axis.position"]
    frame["axis.position"] = STEP * np.round(told / STEP) + 2e-5 * RNG.standard_normal(len(told))
    found = diagnose(frame, AXIS)
    assert [(x.effect, x.location) for x in found.effects] == [
        ("sensor_quantisation", "axis.position")
    ]
    assert found.effects[0].parameters["step"].value == pytest.approx(STEP, rel=1e-3)


def test_nothing_is_said_of_a_signal_that_is_never_judged_or_has_no_noise():
    nothing = np.empty(0)
    assert blurred_step(nothing, nothing, 2.5e-5, 6e-5) is None
    assert blurred_step(SMOOTH + NOISE, NOISE, 0.0, 0.0) is None
    assert blurred_step(np.zeros(500), np.zeros(500), 2.5e-5, 6e-5) is None
