"""`hil config` tells a person, or a script, what a rig file says and what is wrong with it."""

import json
import re

import pytest
import tomlkit
from typer.testing import CliRunner

from hil.cli.app import app, main
from hil.config.bicycle import BICYCLE
from hil.config.sizes import odd_sizes
from hil.configfile import data_folder, find_rig_file, load_any_rig, load_rig
from hil.errors import ConfigError

run = CliRunner().invoke


def test_check_says_that_nothing_is_wrong():
    result = run(app, ["config", "check", "motorcycle"])
    assert result.exit_code == 0
    assert "no fault found" in result.output


def test_a_bicycle_is_checked_and_shown_as_any_rig(tmp_path):
    result = run(app, ["config", "check", "bicycle"])
    assert result.exit_code == 0, result.output
    assert "is a bicycle; no fault found" in result.output
    shown = json.loads(run(app, ["config", "show", "bicycle", "--json"]).output)
    assert shown["kind"] == BICYCLE
    schema = json.loads(run(app, ["config", "schema", "bicycle"]).output)
    assert schema["title"] == "BicycleFile"
    path = tmp_path / "odd.toml"
    path.write_text(
        re.sub(r"(?m)^I2 = .*$", "I2 = [0.06, 0.2, 0.06]", find_rig_file("bicycle").read_text())
    )
    assert "warning" in run(app, ["config", "check", str(path)]).output


def test_every_setting_says_what_it_means():
    shown = run(app, ["config", "show", "axis"]).output
    rows = [line.split("│") for line in shown.splitlines() if line.startswith("│")]
    assert len(rows) > 50
    assert not [key for _, key, _, meaning, _ in rows if key.strip() and not meaning.strip()]


def test_check_answers_no_with_exit_code_one(tmp_path):
    path = tmp_path / "rig.toml"
    path.write_text(find_rig_file("axis").read_text().replace("m = 95.0", "m = -95.0"))
    result = run(app, ["config", "check", str(path), "--json"])
    assert result.exit_code == 1
    answer = json.loads(result.output)
    assert not answer["ok"]
    assert "mass.m" in answer["faults"][0]


@pytest.mark.parametrize("words", [["config", "check"], ["check"]])
def test_a_drive_file_that_there_is_not_is_told_with_rig_file_and_key(tmp_path, words):
    path = tmp_path / "rig.toml"
    tables = tomlkit.parse(find_rig_file("motorcycle").read_text())
    tables["actuators"][1]["drive"]["profile"] = "nosuch"
    path.write_text(tomlkit.dumps(tables))
    answer = json.loads(run(app, [*words, str(path), "--json"]).output)
    assert not answer["ok"]
    (fault,) = answer["faults"] if "faults" in answer else [f["text"] for f in answer["findings"]]
    place = "actuators[1] (leg2).drive.profile: nosuch"
    assert fault.startswith(f"{path}: {place}: no such drive file; those that come with hil are")


def test_a_file_that_there_is_not_is_no_answer(monkeypatch, capsys):
    monkeypatch.setattr("sys.argv", ["hil", "config", "check", "nope.toml"])
    with pytest.raises(SystemExit) as left:
        main()
    assert left.value.code == 2
    assert "nope.toml: no such rig file" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("name", "was", "now", "said"),
    [
        ("axis", "stroke = [-0.25, 0.25]", "stroke = [-250, 250]",
         "actuators[0] (axis).stroke: 250 m is beyond 10 m: are these millimetres?"),
        ("axis", "limits = [0.22] ", "limits = [220]",
         "limits[0] (position): 220 m is beyond 10 m: are these millimetres?"),
        ("motorcycle", "limits = [0.26, 0.26, 0.26]", "limits = [0.26, 15, 0.26]",
         "limits[1] (pitch): 15 rad is beyond 6.28 rad: are these degrees?"),
    ],
)  # fmt: skip
def test_sizes_in_other_units_are_asked_about(name, was, now, said, tmp_path):
    path = tmp_path / "rig.toml"
    text = find_rig_file(name).read_text()
    assert was in text
    path.write_text(text.replace(was, now))
    assert f"warning: {path}: {said}" in run(app, ["config", "check", str(path)]).output
    answer = json.loads(run(app, ["config", "check", str(path), "--json"]).output)
    assert answer["warnings"] == [f"{path}: {said}"]


@pytest.mark.parametrize("path", sorted(data_folder("configs").glob("*.toml")))
def test_sizes_of_the_rigs_that_come_with_hil_are_usual(path):
    if load_any_rig(path).kind != BICYCLE:
        assert odd_sizes(load_rig(path)) == []


AXIS = find_rig_file("axis").read_text()
HERE = '[[effects]]\nlocation = "axis"\n'


@pytest.mark.parametrize(
    ("lines", "said"),
    [
        (f'{HERE}effect = "backlsh"\nparameters = {{ gap = 1e-4 }}',
         "effects[0].effect: 'backlsh' is none of the catalogue; nearest: backlash"),
        (f'{HERE}effect = "payload_mass"\nparameters = {{ mass = 1.0 }}',
         "effects[0].effect: 'payload_mass' does not act at 'axis', but at platform"),
        ('[[effects]]\nlocation = "axs"\neffect = "backlash"\nparameters = { gap = 1e-4 }',
         "effects[0].location: 'axs' is no place of this rig's model; nearest: axis"),
        (f'{HERE}effect = "backlash"\nparameters = {{ gapp = 1e-4 }}',
         "effects[0].parameters.gapp: backlash has no such parameter; it has gap"),
        (f'{HERE}effect = "backlash"\nparameters = {{ gap = 3.0 }}',
         "effects[0].parameters.gap: 3 m lies outside 0..0.02 m (backlash at axis)"),
        (f'{HERE}effect = "backlash"\nparameters = {{}}',
         "effects[0].parameters: is empty, so backlash does nothing; it has gap"),
        (f'{HERE}effect = "backlash"\nparameters = {{ gap = 1e-4 }}\n' * 2,
         "effects[1]: backlash at axis stands there already, as effects[0]"),
    ],
)  # fmt: skip
def test_effects_that_the_model_has_not_are_named_by_file_key_and_bound(lines, said, tmp_path):
    path = tmp_path / "v.toml"
    path.write_text(f"{AXIS}\n{lines}\n")
    result = run(app, ["config", "check", str(path), "--json"])
    assert result.exit_code == 1
    (fault,) = json.loads(result.output)["faults"]
    assert fault.startswith(f"{path}: {said}")
    for used in (["gap", "locate", "run", "--rig", str(path)], ["experiment", str(path), "step"]):
        with pytest.raises(ConfigError) as refused:
            run(app, used, catch_exceptions=False)
        assert str(refused.value) == fault


def test_a_fault_of_an_actuator_is_one_fault(tmp_path):
    path = tmp_path / "rig.toml"
    path.write_text(AXIS.replace("viscous = ", "viscous = -"))
    answer = json.loads(run(app, ["config", "check", str(path), "--json"]).output)
    (fault,) = answer["faults"]
    assert "actuators[0] (axis).viscous" in fault


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
