"""Drivers of a rig file, and the contradictions that are refused before anything moves."""

from __future__ import annotations

import pytest

from hil.drives import build_drivers
from hil.errors import ConfigError
from tests.drives.exchange import profile_of, rig_of

PROFILES = {"lust_cdd3000": profile_of()}


def test_one_driver_an_actuator_in_order() -> None:
    bus = build_drivers(rig_of("motorcycle"), PROFILES)
    assert [d.name for d in bus] == ["leg1", "leg2", "slide"]
    assert len(bus) == 3
    assert bus[2].name == "slide"
    assert bus[0].setpoint_kind == "position"


@pytest.mark.parametrize(
    ("changes", "profile", "text"),
    [
        ({"bus": {"schedule": "fast"}}, {}, 'set "parameter"'),
        ({"bus": {"pattern": ["force"]}}, {}, 'must ask for "position"'),
        ({"bus": {"cycle": 0.005}}, {}, "slots would go unused"),
        (
            {"control": {"mode": "cascade"}},
            {"layout": {"torque_reference": False}},
            "sends forces, which lust_cdd3000 does not take",
        ),
        ({"safety": {"drive_watchdog": 0.1}}, {"parameters": "short"}, "takes 1..50"),
    ],
)
def test_contradictions_are_told_in_a_sentence(changes: dict, profile: dict, text: str) -> None:
    if profile.get("parameters") == "short":
        parameters = profile_of().model_dump()["parameters"]
        parameters["watchdog"]["largest"] = 50
        profile = {"parameters": parameters}
    with pytest.raises(ConfigError, match=text):
        build_drivers(rig_of(**changes), {"lust_cdd3000": profile_of(**profile)})


def test_an_address_beyond_its_group_is_refused() -> None:
    actuators = [dict(a) for a in rig_of().model_dump()["actuators"]]
    actuators[0]["drive"]["address"] = 110
    rig = rig_of(actuators=actuators)
    assert len(build_drivers(rig, PROFILES)) == 1
    with pytest.raises(ConfigError, match="at stride 2 the largest is 109"):
        build_drivers(rig, {"lust_cdd3000": profile_of(ids={"stride": 2})})


def test_a_stroke_beyond_what_a_position_holds_is_refused() -> None:
    actuators = [dict(a) for a in rig_of().model_dump()["actuators"]]
    actuators[0]["drive"]["counts_per_unit"] = 1e10
    with pytest.raises(
        ConfigError, match=r"axis has 2\.5e\+09 increments at the end of its stroke"
    ):
        build_drivers(rig_of(actuators=actuators), PROFILES)


def test_a_drive_file_that_is_not_there_is_named() -> None:
    with pytest.raises(ConfigError, match="no drive file for"):
        build_drivers(rig_of(), {})
