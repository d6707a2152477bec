"""Intervals hold: over many experiments with drawn truths they contain it as often as they say."""

from __future__ import annotations

from benchmarks.figure import Options
from benchmarks.interval_coverage import coverage, measure


def test_intervals_of_forty_experiments_hold_the_truth_as_often_as_they_say() -> None:
    found = coverage("axis", "iv", 40)
    # 120 intervals, nearly independent: 95 % +- 2 % (one standard deviation), 3.5 of them allowed
    assert sum(shares[1] for shares in found.values()) / len(found) >= 0.88
    for _, _, mean, spread in found.values():
        assert abs(mean) < 0.6
        assert 0.75 < spread < 1.4


def test_the_table_has_a_row_for_each_part_and_says_which_parameter_fares_worst() -> None:
    (table,) = measure(Options(quick=True, parts=("axis-wls",)))
    assert list(table.rows) == ["axis wls"]
    assert table.value("axis wls", "of 95 %") > 0.6
    assert table.column("worst")["axis wls"] in ("mass.m", "viscous", "coulomb")
