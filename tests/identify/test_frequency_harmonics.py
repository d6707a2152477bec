"""Harmonics on uneven instants, and the period of a cue."""

from __future__ import annotations

import numpy as np
import pytest

from hil.errors import IdentificationError
from hil.identify.frequency.harmonics import (
    find_period,
    harmonic_amplitudes,
    repeating_stretch,
    waveform,
)
from tests.identify.frequency_data import Multisine, irregular

RNG = np.random.default_rng(7)
LINES = np.array([1, 3, 4, 9, 17])


def test_uneven_samples_give_every_line_exactly_and_nothing_between():
    wave = Multisine(LINES, [1.0, 0.5, 0.2, 0.1, 0.05], 4.0, RNG)
    t = irregular(10.0, 14.0, 0.02, RNG)
    found = harmonic_amplitudes(t, 3.0 + wave.at(t), 10.0, 4.0, 80)
    turned = wave.phasors * np.exp(2j * np.pi * LINES * 10.0 / 4.0)
    assert found[LINES] == pytest.approx(turned, abs=1e-12)
    assert found[0] == pytest.approx(3.0)
    rest = np.delete(found, [0, *LINES])
    assert np.abs(rest).max() < 1e-12


def test_where_a_quarter_of_the_period_is_missing_the_lines_cannot_be_told():
    t = irregular(0.0, 4.0, 0.02, RNG)
    t = t[(t < 1.0) | (t > 2.0)]
    with pytest.raises(IdentificationError, match=r"unevenly.*longest gap 10\d\d\.\d ms"):
        harmonic_amplitudes(t, np.sin(t), 0.0, 4.0, 60)


def test_more_lines_than_samples_are_refused():
    t = np.arange(0.0, 1.0, 0.02)
    with pytest.raises(IdentificationError, match="50 samples cannot tell 40 lines"):
        harmonic_amplitudes(t, np.sin(t), 0.0, 1.0, 40)


def test_a_waveform_is_the_harmonics_added_up():
    x = waveform(np.array([0.5, 1.0, 0.0, 0.25j]), 64)
    t = np.arange(64) / 64
    expected = 0.5 + np.cos(2 * np.pi * t) - 0.25 * np.sin(2 * np.pi * 3 * t)
    assert x == pytest.approx(expected, abs=1e-12)


def test_the_period_is_found_between_fades_and_rests():
    wave = Multisine(LINES, [1.0, 0.5, 0.2, 0.1, 0.05], 4.0, RNG)
    t = np.arange(0.0, 30.0, 0.01)
    x = wave.at(t) * np.clip((t - 3.0) / 2.0, 0.0, 1.0) * np.clip((27.0 - t) / 2.0, 0.0, 1.0)
    assert find_period(t, x) == pytest.approx(4.0, abs=1e-9)
    start, end = repeating_stretch(t, x, 4.0)
    assert start == pytest.approx(5.0, abs=0.05)
    assert end == pytest.approx(25.0, abs=0.05)


@pytest.mark.parametrize(
    "x",
    [
        lambda t: np.sin(0.2 * t * t),
        lambda t: np.random.default_rng(1).standard_normal(len(t)),
        np.zeros_like,
        lambda t: np.clip(t - 5.0, 0.0, 1.0),
    ],
    ids=["chirp", "noise", "standstill", "one step"],
)
def test_what_does_not_repeat_has_no_period(x):
    t = np.arange(0.0, 30.0, 0.02)
    assert find_period(t, x(t)) is None
