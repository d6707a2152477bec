"""Ratings after ISO/TS 18571 behave as the specification says they must."""

import numpy as np
import pytest

from hil.errors import IdentificationError
from hil.gap.iso18571 import rate

T = np.linspace(0.0, 2.0, 401)
CURVE = np.sin(2.0 * np.pi * T) * np.exp(-T)


def test_identical_curves_score_one_in_everything():
    found = rate(T, CURVE, CURVE)
    parts = (found.corridor, found.phase, found.magnitude, found.slope, found.overall)
    assert parts == pytest.approx((1.0,) * 5)
    assert found.grade == "excellent"


def test_a_late_curve_loses_phase_by_its_share_of_a_fifth_of_the_time():
    late = np.interp(T - 0.1, T, CURVE, left=0.0)
    found = rate(T, CURVE, late)
    assert found.phase == pytest.approx(1.0 - 0.1 / (0.2 * 2.0), abs=0.02)
    assert found.magnitude > 0.98
    assert found.slope > 0.95


def test_a_larger_curve_loses_magnitude_and_slope_and_no_phase():
    found = rate(T, CURVE, 1.2 * CURVE)
    assert found.phase == 1.0
    assert found.slope == pytest.approx(1.0 - 0.2 / 2.0, abs=0.01)
    assert 0.6 < found.magnitude < 0.95  # warping takes a part of it away


def test_within_the_inner_corridor_nothing_is_lost_and_beyond_the_outer_all():
    top = float(np.max(np.abs(CURVE)))
    assert rate(T, CURVE, CURVE + 0.049 * top).corridor == pytest.approx(1.0)
    assert rate(T, CURVE, CURVE + 0.51 * top).corridor == 0.0


def test_curves_that_cannot_be_rated_are_refused():
    with pytest.raises(IdentificationError, match="too few"):
        rate(T[:10], CURVE[:10], CURVE[:10])
    with pytest.raises(IdentificationError, match="zero throughout"):
        rate(T, 0.0 * CURVE, CURVE)
