"""The published record of a real ball-screw axis gives the published parameters."""

from __future__ import annotations

from pathlib import Path

import pytest

from hil.configfile import load_rig
from hil.identify.estimate import identify
from hil.runs import load_run
from hil.runs.importing import find_map, import_run
from tests.shared_data import shared

PUBLISHED = {
    "mass.m": 95.1089,
    "axis.viscous": 203.5034,
    "axis.coulomb": 20.3935,
    "axis.force.sensor_bias.offset": -3.1648,
}
"""Janot, Gautier, Brunot: Data Set and Reference Models of EMPS, 2019; force error 4.08 %."""


@pytest.mark.shared
def test_the_emps_axis_is_identified_within_a_percent_of_the_published_values(
    tmp_path: Path,
) -> None:
    log = shared("data/emps/DATA_EMPS.mat")
    import_run(log, find_map("emps"), tmp_path / "emps", "emps")
    rig = load_rig("emps")
    result = identify([load_run(tmp_path / "emps", rig)], rig).identification
    for name, value in PUBLISHED.items():
        assert result[name].value == pytest.approx(value, rel=0.01)
        assert result[name].ci95[0] < value < result[name].ci95[1]
    assert result.fit["axis.force"] < 0.0408
