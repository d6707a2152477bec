"""Drive files: what they must say, and how they are refused."""

from __future__ import annotations

import pytest
from pydantic import ValidationError

from hil.configfile import load_drive, parse_settings
from hil.drivefiles import load_profile
from hil.drives.cia402.profile import Cia402Profile, Expected
from hil.drives.profile import LustProfile
from hil.errors import ConfigError
from tests.drives.exchange import profile_of


def test_the_shipped_file_has_the_identifiers_of_the_manual() -> None:
    ids = load_drive("lust_cdd3000", LustProfile).ids
    assert (ids.system, ids.error, ids.control, ids.status) == (221, 441, 661, 881)
    assert (ids.request, ids.answer, ids.log_on) == (1101, 1321, 1543)


def test_every_setting_of_a_drive_file_is_required() -> None:
    tables = profile_of().model_dump()
    for table in ("ids", "layout", "timing", "supervision", "parameters", "errors", "homing"):
        short = {k: v for k, v in tables.items() if k != table}
        with pytest.raises(ConfigError, match=f"{table} is missing"):
            parse_settings(short, LustProfile, "drive.toml")


def test_an_unknown_key_is_named() -> None:
    tables = profile_of().model_dump()
    tables["layout"]["colour"] = 3
    with pytest.raises(ConfigError, match=r"drive\.toml: layout\.colour is not a key"):
        parse_settings(tables, LustProfile, "drive.toml")


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"ids": {"stride": 3}}, "stride"),
        ({"ids": {"status": 700}}, "closer than a group"),
        ({"layout": {"value_byte": 2}}, "lies inside the value's bytes"),
        ({"error_frame": {"hours_byte": 0}}, "share a byte"),
        ({"errors": ()}, 'kind = "watchdog"'),
        ({"timing": {"listen": 0.0}}, "listen"),
    ],
)
def test_settings_that_contradict_each_other_are_refused(changes: dict, text: str) -> None:
    with pytest.raises(ValidationError, match=text):
        profile_of(**changes)


def test_error_codes_must_be_unique() -> None:
    errors = list(profile_of().model_dump()["errors"])
    with pytest.raises(ValidationError, match="not unique"):
        profile_of(errors=[*errors, errors[0]])


def test_an_error_number_that_the_file_does_not_know_is_still_told() -> None:
    assert "error 250" in profile_of().error_text(250)
    assert profile_of().error_text(33).startswith("E-LSW")


def test_the_cda3000_layout_of_the_manual_can_be_set() -> None:
    """Reference at byte 2 (manual, 5-13); the flags then need another place."""
    layout = profile_of(layout={"value_byte": 2, "flags_byte": 6}).layout
    assert layout.value_byte == 2


@pytest.mark.parametrize(
    ("index", "value", "text"),
    [
        (0x607F, 0, None),
        (0x607E, 256, r"expected: 0x607e:00: .* 256 is no whole number within 0\.\.255"),
        (0x5FFF, 0, r"expected: 0x5fff:00 is not in .*: take it out"),
        (0x1008, 0, "is no whole number that can be read"),
    ],
)
def test_what_a_drive_is_expected_to_hold_must_be_in_its_eds_and_fit(index, value, text) -> None:
    profile = load_profile("cia402")
    assert isinstance(profile, Cia402Profile)
    wanted = Expected(index=index, value=value, text="it would not")
    changed = profile.model_copy(update={"expected": (wanted,)})
    if text is None:
        assert changed.with_objects(profile.objects).expected == (wanted,)
        return
    with pytest.raises(ConfigError, match=text):
        changed.with_objects(profile.objects)
