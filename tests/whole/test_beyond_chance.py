"""A small gap explained as a whole and nearly for certain stands, though unseen data hardly show it."""

from __future__ import annotations

import pytest

from hil.gap import diagnose
from hil.gap.judged import verdict
from tests.gap.twin_runs import AXIS, effect, record


@pytest.fixture(autouse=True)
def unseen_data_are_faint(monkeypatch: pytest.MonkeyPatch) -> None:
    """The held-out part shows hardly any gap."""
    monkeypatch.setattr(verdict, "_is_faint", lambda _: True)


def test_flanks_that_meet_in_what_was_seen_are_named() -> None:
    found = diagnose(record(effect("backlash", gap=1.5e-5)), AXIS)
    assert [x.effect for x in found.effects] == ["backlash"]


def test_what_is_less_certain_is_taken_for_chance(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(verdict, "WHOLE", 1.1)
    assert diagnose(record(effect("backlash", gap=1.5e-5)), AXIS).verdict == "no_gap"
