"""`hil config` tells a person, or a script, what a rig file says and what is wrong with it."""

import json

from typer.testing import CliRunner

from hil.cli.app import app
from hil.configfile import find_rig_file

run = CliRunner().invoke


def test_check_says_that_nothing_is_wrong():
    result = run(app, ["config", "check", "motorcycle"])
    assert result.exit_code == 0
    assert "no fault found" in result.output


def test_check_answers_no_with_exit_code_one(tmp_path):
    path = tmp_path / "rig.toml"
    path.write_text(find_rig_file("axis").read_text().replace("m = 95.0", "m = -95.0"))
    result = run(app, ["config", "check", str(path), "--json"])
    assert result.exit_code == 1
    answer = json.loads(result.output)
    assert not answer["ok"]
    assert "mass.m" in answer["faults"][0]


def test_show_fills_in_the_defaults():
    shown = json.loads(run(app, ["config", "show", "axis", "--json"]).output)
    assert shown["safety"]["drive_watchdog"] == 0.1


def test_show_gives_each_key_its_meaning():
    result = run(app, ["config", "show", "axis"], env={"COLUMNS": "200"})
    assert "actuators[axis].viscous" in result.output
    assert "N·s/m" in result.output


def test_schema_can_be_narrowed_to_a_kind():
    schema = json.loads(run(app, ["config", "schema", "motorcycle"]).output)
    assert schema["properties"]["geometry"] == {"$ref": "#/$defs/MotorcycleGeometry"}
    assert schema["additionalProperties"] is False
