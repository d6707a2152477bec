"""The answer file as `hil gap apply` and `next` read it: broken ones are named, whole ones applied."""

import json
import math

import pytest
from typer.testing import CliRunner

from hil.cli.app import app
from hil.cli.gap_answer import read_answer_file
from hil.errors import RunError


def answer(**changes):
    stiffness = {"value": 2e5, "ci": [1e5, None], "unit": "N/m", "at_bound": False}
    cause = {
        "effect": "compliance", "location": "axis", "probability": 0.9, "class": 0,
        "parameters": {"stiffness": stiffness},
    }  # fmt: skip
    return {
        "format": "hil-diagnosis/1", "rig": "axis", "runs": ["run7"], "verdict": "identified",
        "gap": {"shrink": 0.9, "shrink_ci": [0.8, 1.0], "signals": {"axis.force": {}}},
        "causes": [cause], "effects": [cause], **changes,
    }  # fmt: skip


BROKEN = {
    "no diagnosis: its format": {"format": None},
    "field `rig`|`str`, got `null`": {"rig": None},
    "Expected `array`, got `str`": {"causes": "abc"},
    "Expected `object`, got `null`": {"gap": None},
    "missing required field `effect`": {"effects": [{}]},
}


@pytest.mark.parametrize("command", ["apply", "next"])
@pytest.mark.parametrize("what", BROKEN)
def test_a_broken_answer_is_named(tmp_path, command, what):
    path = tmp_path / "d.json"
    path.write_text(json.dumps(answer(**BROKEN[what])))
    said = ["gap", command, str(path), "--rig", "axis", "--out", str(tmp_path / "new.toml")]
    with pytest.raises(RunError, match=what):
        CliRunner().invoke(app, said, catch_exceptions=False)


def test_an_interval_without_an_end_is_applied(tmp_path):
    path, new = tmp_path / "d.json", tmp_path / "new.toml"
    path.write_text(json.dumps(answer()))
    assert read_answer_file(path)["effects"][0]["parameters"]["stiffness"]["ci"] == [1e5, math.inf]
    said = ["gap", "apply", str(path), "--rig", "axis", "--out", str(new)]
    assert CliRunner().invoke(app, said, catch_exceptions=False).exit_code == 0
    assert "stiffness: 1e+05 .. inf N/m (90 %)" in new.read_text()
