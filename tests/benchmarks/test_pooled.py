"""Marks of several exams together."""

import json

import pytest
from benchmarks.pooled import pooled


def exam(folder, name, papers, marks, bins):
    """A marks file of one group."""
    path = folder / name
    rows = [{"mark": m, "value": v, "count": n} for m, v, n in marks]
    table = [{"from": f, "count": n, "stated": s, "came": c} for f, n, s, c in bins]
    path.write_text(
        json.dumps({"groups": [{"papers": papers, "marks": rows}], "reliability": table})
    )
    return path


@pytest.fixture
def files(tmp_path):
    first = [
        ("top-1 by class", 0.9, 50), ("false alarms on null cases", 0.0, 10), ("never", None, 0),
        ("expected calibration error", 0.1, 4), ("mean size of the 90 % set", 1.0, 10),
        ("time for 30 s of record, median", 9.0, 60), ("parameter error, all parameters", 0.011, 60),
    ]  # fmt: skip
    second = [
        ("top-1 by class", 1.0, 50), ("false alarms on null cases", 0.1, 20), ("never", None, 0),
        ("expected calibration error", 0.1, 4), ("mean size of the 90 % set", 2.0, 30),
        ("time for 30 s of record, median", 12.0, 70), ("parameter error, all parameters", 0.0244, 70),
    ]  # fmt: skip
    return [
        exam(tmp_path, "a.json", 60, first, [(0.9, 4, 0.95, 1.0)]),
        exam(tmp_path, "b.json", 70, second, [(0.9, 12, 0.95, 0.9), (0.5, 4, 0.5, 1.0)]),
    ]


def test_shares_are_pooled_by_counts_and_probabilities_by_tenths(files):
    rows = dict(pooled(files))
    assert rows["cases at 3 floors and more"] == "130"
    assert rows["top-1 by class"] == "95.0 % (89 to 98) of 100"
    assert rows["false alarms on null cases"] == "2 of 30"
    assert rows["mean size of the 90 % set"] == "1.75"
    assert rows["time for 30 s of record, median"] == "9 to 12"
    assert rows["parameter error, all parameters"] == "1.1 to 2.4 %"
    # 0.9 to 1: 16 cases, 0.95 stated, 0.925 came; 0.5 to 0.6: 4 cases, 0.5 and 1
    assert rows["expected calibration error"] == f"{(16 * 0.025 + 4 * 0.5) / 20:.3f}"
    assert "never" not in rows
