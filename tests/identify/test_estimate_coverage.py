"""Intervals hold: over many experiments with drawn truths they contain it as often as they say."""

from __future__ import annotations

from benchmarks.interval_coverage import NAMES, coverage


def test_intervals_of_forty_experiments_hold_the_truth_as_often_as_they_say() -> None:
    table = coverage(40, ("iv",))
    inside = [table.value(f"iv {name}", "of 95 %") for name in NAMES]
    # 120 intervals, nearly independent: 95 % +- 2 % (one standard deviation), 3.5 of them allowed
    assert sum(inside) / len(inside) >= 0.88
    for name in NAMES:
        assert abs(table.value(f"iv {name}", "mean error / std")) < 0.6
        assert 0.75 < table.value(f"iv {name}", "spread of error / std") < 1.4
