"""A rig file says everything about a rig; whatever is wrong in it is named by file, key and bound."""

import copy
import json

import pytest

from hil.config import BicycleFile, RigFile
from hil.configfile import (
    data_folder,
    find_rig_file,
    load_any_rig,
    load_rig,
    parse_settings,
    read_toml,
    toml_text,
)
from hil.errors import ConfigError
from tests.shared_data import shared

SHIPPED = sorted(p.stem for p in data_folder("configs").glob("*.toml"))


@pytest.mark.parametrize("name", SHIPPED)
def test_every_shipped_rig_file_loads(name):
    rig = load_any_rig(name)
    assert rig.actuator_names or rig.kind == "bicycle"


@pytest.mark.shared
def test_shipped_rigs_carry_the_nominal_numbers():
    nominal = json.loads(shared("rigs.json").read_text())["rigs"]
    for name in set(SHIPPED) & set(nominal) - {"bicycle"}:
        expected = parse_settings(nominal[name], RigFile, name).model_dump()
        ours = load_rig(name).model_dump()
        for table in ("geometry", "mass", "bus", "imu", "noise", "limits", "coordinates"):
            assert ours[table] == expected[table], f"{name}.{table}"
        for mine, theirs in zip(ours["actuators"], expected["actuators"], strict=True):
            for key in nominal[name]["actuators"][0]:
                assert mine[key] == theirs[key], f"{name}.{mine['name']}.{key}"


@pytest.mark.shared
def test_the_nominal_rigs_are_rig_files_as_they_are():
    for name, tables in json.loads(shared("rigs.json").read_text())["rigs"].items():
        model = BicycleFile if name == "bicycle" else RigFile
        assert parse_settings(tables, model, name).kind == tables["kind"]


def broken(change):
    tables = copy.deepcopy(read_toml(find_rig_file("motorcycle")))
    change(tables)
    with pytest.raises(ConfigError) as caught:
        parse_settings(tables, RigFile, "rig.toml")
    return str(caught.value)


def test_unknown_keys_are_named():
    text = broken(lambda t: t["mass"].update(weight=3.0))
    assert text == "rig.toml: mass.weight is not a key that hil knows"


def test_a_bound_is_named_with_the_actuator():
    text = broken(lambda t: t["actuators"][1].update(viscous=-1.0))
    assert text.startswith("rig.toml: actuators[1] (leg2).viscous:")
    assert "greater than or equal to 0" in text
    assert "-1" in text


def test_a_missing_key_is_named():
    assert broken(lambda t: t["geometry"].pop("L")) == "rig.toml: geometry.L is missing"


def test_geometry_of_another_kind_is_refused():
    text = broken(lambda t: t.update(kind="axis_1dof"))
    assert "geometry.L is not a key that hil knows" in text


@pytest.mark.parametrize(
    ("change", "part"),
    [
        (lambda t: t["actuators"].pop(), "3 actuators, the file has 2"),
        (lambda t: t["actuators"][1].update(name="leg1"), "names are not unique"),
        (lambda t: t["actuators"][1]["drive"].update(address=1), "addresses are not unique"),
        (lambda t: t["actuators"][0].update(stroke=[0.9, 0.3]), "lower end 0.9"),
        (lambda t: t["actuators"][0].update(home=2.0), "home 2.0 lies outside stroke"),
        (lambda t: t.update(limits=[0.2]), "limits needs 3 values"),
        (lambda t: t.update(coordinates=["roll", "pitch", "yaw"]), "in this order"),
        (lambda t: t.update(parking={"pose": [0.0, 0.5, 0.0]}), "pitch = 0.5 lies outside"),
        (lambda t: t["mass"]["inertia"][0].__setitem__(1, 3.0), "not symmetric"),
        (lambda t: t["bus"].update(cycle=1.0), "bus.cycle"),
        (lambda t: t.update(safety={"drive_watchdog": 1.5}), "noticed far too late"),
        (lambda t: t["mass"].update(m=float("nan")), "mass.m"),
    ],
)
def test_what_does_not_fit_together_is_said(change, part):
    assert part in broken(change)


def test_all_faults_are_told_at_once():
    def change(tables):
        tables["mass"]["weight"] = 1.0
        tables["actuators"][0]["coulomb"] = -2.0

    assert len(broken(change).splitlines()) == 2


def test_a_file_that_is_no_toml_names_the_place(tmp_path):
    path = tmp_path / "rig.toml"
    path.write_text("name = [")
    with pytest.raises(ConfigError, match=r"rig\.toml: is no TOML"):
        load_rig(path)


def test_the_mark_that_windows_editors_begin_a_file_with_is_passed_over(tmp_path):
    path = tmp_path / "rig.toml"
    path.write_text(find_rig_file("axis").read_text(encoding="utf-8"), encoding="utf-8-sig")
    assert load_rig(path) == load_rig("axis")
    assert toml_text(path) == toml_text(find_rig_file("axis"))


def test_a_name_that_is_not_there_lists_those_that_are():
    with pytest.raises(ConfigError, match=r"come with hil are axis, .*motorcycle"):
        load_rig("lorry")


def test_a_resolved_rig_loads_again():
    rig = load_rig("motorcycle")
    assert parse_settings(rig.model_dump(), RigFile, "again") == rig


def test_current_becomes_force_through_screw_and_torque_constant():
    leg = load_rig("motorcycle").actuators[0]
    assert leg.force_per_ampere == pytest.approx(0.55 * 2 * 3.141592653589793 / 0.005 * 0.9)


def test_a_motors_turn_by_its_transmission():
    """Way a turn: a screw's lead; a pinion's circle, or a whole turn, over the gear."""
    leg, slide = load_rig("motorcycle").actuators[1:]
    assert leg.motor_turn == leg.transmission.lead
    rack = slide.transmission
    turns_a_metre = rack.gear / (2.0 * 3.141592653589793 * rack.pinion_radius)  # of the motor
    assert slide.motor_turn == pytest.approx(1.0 / turns_a_metre)
    assert leg.model_copy(update={"transmission": None}).motor_turn is None
