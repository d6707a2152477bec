"""The signs that thresholds are set on, of a gap and of none."""

from dataclasses import replace

import pandas as pd
import pytest
from benchmarks.gap_signs import row_of, signs, slow_band, table

from hil.exam.case import write_case
from hil.gap.diagnose import consider, diagnose
from hil.gap.located.result import Place
from tests.gap.twin_runs import AXIS, effect, record


def test_signs_of_friction_and_of_a_healthy_axis():
    best, found = signs(consider(record(effect("coulomb_friction", force=40.0)), AXIS))
    assert best is not None
    assert best.leaves[0].effect == "coulomb_friction"
    assert found["share"] > 0.9
    assert found["unseen"] > 0.9
    assert found["stands"] > 1.5
    assert found["nats"] > 15.0
    assert found["floors"] > 2.0
    _, healthy = signs(consider(record(), AXIS))
    assert healthy["floors"] < 1.5
    assert healthy["force_band"] < 4.8
    assert healthy["position_band"] < 3.8
    assert healthy["nats"] < 10.0
    assert healthy["priors"] < 10.0


def test_of_bands_only_slow_ones_of_the_signals_asked_for_count():
    places = (
        Place("axis.force", (0.0, 1.0), "everywhere", 0.2, (0.1, 0.3), 1.0, 9.0, 2.0),
        Place("axis.force", (1.0, 4.0), "everywhere", 0.7, (0.6, 0.8), 1.0, 90.0, 2.0),
        Place("imu.accel_x", (0.0, 1.0), "everywhere", 0.1, (0.0, 0.2), 1.0, 8.0, 1.0),
    )
    located = replace(consider(record(), AXIS).located, where=places)
    assert slow_band(located, ("force", "current")) == pytest.approx(4.5)
    assert slow_band(located, ("position",)) == 0.0


def test_quantiles_stand_by_kind():
    rows = pd.DataFrame(
        {
            "kind": ["single", "single", "none"],
            "is_right": [True, False, False],
            "share": [0.9, 0.4, 0.1],
        }
    )
    found = table(rows)
    assert found.loc[("catalogue, right", 0.5), "share"] == pytest.approx(0.9)
    assert found.loc[("none", 0.5), "cases"] == 1


def test_a_row_stands_beside_its_answer(tmp_path):
    answer = {
        "verdict": "identified",
        "effects": [
            {"effect": "coulomb_friction", "location": "axis", "parameters": {"force": 40.0}}
        ],
    }
    run = record(effect("coulomb_friction", force=40.0))
    write_case("axis-0001", AXIS, [(run, "diagnose", None)], answer, 1, tmp_path)
    row = row_of(tmp_path / "cases" / "axis-0001")
    assert row["said"] == diagnose(run, AXIS).verdict
    assert row["is_right"]
    assert row["nearest"] == "axis.coulomb_friction"
