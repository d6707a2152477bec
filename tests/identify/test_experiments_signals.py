"""Signals are what was published, begin and end at rest, and do not drift."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hil.identify.experiments.signals import (
    SWEEP_C1,
    SWEEP_C2,
    Motion,
    bridged,
    carried_on,
    chirp,
    faded,
    multisine,
    smooth_step,
    sweep,
    sweep_frequency,
    sweep_phase,
)

STEP_S = 1e-3


def test_the_sweep_has_the_published_constants():
    """C1 = 4.0 and C2 = 1/(e^4 - 1), which is printed rounded, 0.0187."""
    assert SWEEP_C1 == 4.0
    assert pytest.approx(1.0 / (np.e**4 - 1.0), rel=1e-15) == SWEEP_C2
    assert round(SWEEP_C2, 4) == 0.0187


def test_the_sweep_reaches_its_last_frequency_exactly_and_holds_its_first():
    t = np.array([-5.0, -1.0, 0.0, 60.0])
    assert sweep_frequency(t, 0.2, 3.0, 60.0) / (2 * np.pi) == pytest.approx([0.2, 0.2, 0.2, 3.0])


def test_half_way_the_sweep_is_where_the_published_formula_puts_it():
    half = 0.2 + (np.exp(2.0) - 1.0) / (np.exp(4.0) - 1.0) * 2.8
    assert sweep_frequency(np.array([30.0]), 0.2, 3.0, 60.0)[0] / (2 * np.pi) == pytest.approx(half)


def test_the_phase_of_the_sweep_is_the_integral_of_its_frequency():
    t = np.linspace(-5.0, 60.0, 65001)
    w = sweep_frequency(t, 0.2, 3.0, 60.0)
    summed = np.concatenate([[0.0], np.cumsum(0.5 * (w[1:] + w[:-1]) * np.diff(t))])
    assert sweep_phase(t, 0.2, 3.0, 60.0) == pytest.approx(summed, abs=1e-4)


def test_the_sweep_keeps_its_amplitude_in_acceleration():
    motion = sweep(0.2, 3.0, 60.0, STEP_S)
    theta = sweep_phase(np.arange(len(motion.a)) * STEP_S - 5.0, 0.2, 3.0, 60.0)
    assert np.max(np.abs(motion.a - np.sin(theta))) < 1e-4


def test_the_faded_sweep_does_not_drift():
    """Its mean stays a small part of the largest excursion; a plain double integral's does not."""
    motion = faded(sweep(0.2, 3.0, 60.0, STEP_S), 5000, 3000)
    assert abs(motion.p[-1]) < 1e-12
    second_half = motion.p[len(motion.p) // 2 :]
    assert abs(np.mean(second_half)) < 0.01 * np.max(np.abs(motion.p))


@pytest.mark.parametrize("law", ["linear", "log"])
def test_a_chirps_speed_and_acceleration_are_its_derivatives(law):
    motion = chirp(law, 0.1, 5.0, 20.0, STEP_S)
    assert np.gradient(motion.p, STEP_S)[1:-1] == pytest.approx(motion.v[1:-1], abs=6e-3)
    assert np.gradient(motion.v, STEP_S)[1:-1] == pytest.approx(motion.a[1:-1], abs=0.2)
    assert motion.v[-1] == pytest.approx(
        2 * np.pi * 5.0 * np.cos(np.arcsin(motion.p[-1])), rel=0.02
    )


@settings(max_examples=20, deadline=None)
@given(
    hz=st.floats(0.05, 5.0),
    phase=st.floats(0.0, 6.28),
    fade_in=st.integers(500, 4000),
    fade_out=st.integers(500, 4000),
)
def test_a_faded_motion_goes_from_rest_to_rest_through_the_motion_itself(
    hz, phase, fade_in, fade_out
):
    t = np.arange(12001) * STEP_S
    w = 2.0 * np.pi * hz
    plain = Motion(
        STEP_S, -(w**2) * np.sin(w * t + phase), w * np.cos(w * t + phase), np.sin(w * t + phase)
    )
    made = faded(plain, fade_in, fade_out)
    assert len(made.p) == len(plain.p)
    for ends in (made.a, made.v, made.p):
        assert ends[[0, -1]] == pytest.approx([0.0, 0.0], abs=1e-9 * (1 + w**2))
    inside = slice(fade_in, len(t) - fade_out)
    assert made.p[inside] == pytest.approx(plain.p[inside], abs=1e-9)
    speed = np.concatenate([[0.0], np.cumsum(0.5 * (made.a[1:] + made.a[:-1]) * STEP_S)])
    assert speed == pytest.approx(made.v, abs=1e-3 * np.max(np.abs(made.v)) + 2e-6 * w**3)


def test_the_fade_is_in_acceleration():
    """At its ends neither acceleration nor jerk jumps: the window has three derivatives."""
    made = faded(sweep(0.5, 3.0, 20.0, STEP_S), 2000, 2000)
    jerk = np.diff(made.a) / STEP_S
    assert np.max(np.abs(np.diff(jerk[:4]))) < 1e-6 * np.max(np.abs(jerk))
    assert abs(made.a[1]) < 1e-9
    bends = np.abs(np.diff(jerk))
    assert bends[1999] < 2.0 * np.median(bends[1950:2050])  # nor where the fade ends


def test_a_bridge_leads_from_state_to_state():
    made = bridged(np.zeros(1001), STEP_S, (0.3, -0.1), (-0.2, 0.4))
    assert (made.v[0], made.p[0]) == (0.3, -0.1)
    assert (made.v[-1], made.p[-1]) == pytest.approx((-0.2, 0.4), abs=1e-12)


def test_a_multisine_has_its_lines_and_nothing_else():
    harmonics = np.array([3, 7, 20])
    amplitudes = np.array([1.0, 0.5, 0.1])
    motion = multisine(harmonics, amplitudes, np.array([0.1, 2.0, 4.0]), 5000, STEP_S)
    spectrum = 2.0 * np.abs(np.fft.rfft(motion.p)) / 5000
    assert spectrum[harmonics] == pytest.approx(amplitudes, rel=1e-12)
    assert np.max(np.delete(spectrum, harmonics)) < 1e-12
    t = np.arange(5000) * STEP_S
    w = 2 * np.pi * harmonics / 5.0
    angles = w[:, None] * t + np.array([[0.1], [2.0], [4.0]])
    assert motion.p == pytest.approx((amplitudes[:, None] * np.cos(angles)).sum(0), abs=1e-10)
    assert motion.a == pytest.approx(
        -((amplitudes * w**2)[:, None] * np.cos(angles)).sum(0), abs=1e-7
    )


def test_a_period_is_carried_on_backwards_and_forwards():
    motion = multisine(np.array([1]), np.array([1.0]), np.array([0.0]), 100, STEP_S)
    assert carried_on(motion, -100, 300).p[[0, 100, 200]] == pytest.approx([1.0, 1.0, 1.0])


def test_the_smooth_step_has_three_derivatives_of_zero_at_both_ends():
    u = np.linspace(0.0, 1.0, 10001)
    s = smooth_step(u)
    assert (s[0], s[-1]) == (0.0, 1.0)
    assert s[1] == pytest.approx(35.0 * 1e-16, rel=1e-3)
    assert 1.0 - s[-2] == pytest.approx(35.0 * 1e-16, rel=0.2)
