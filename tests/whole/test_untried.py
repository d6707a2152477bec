"""What is claimed where effects were withheld."""

from __future__ import annotations

import pytest

from hil.gap import Diagnosis, diagnose
from hil.gap.judged.untried import UNTRIED, beside_untried
from tests.gap.twin_runs import AXIS, effect, record


@pytest.fixture(scope="module")
def found() -> Diagnosis:
    """Of friction for which the very law was withheld: Coulomb's takes its place."""
    worn = record(effect("asymmetric_friction", positive=190.0, negative=160.0))
    return diagnose(worn, AXIS, without=["asymmetric_friction"])


def test_a_relative_of_what_was_withheld_is_not_claimed_for_sure(found: Diagnosis) -> None:
    assert found.effects[0].effect == "coulomb_friction"
    assert found.effects[0].probability <= 1.0 - UNTRIED
    assert found.effects[0].probability == found.causes[0].probability
    assert found.unknown >= UNTRIED
    assert found.sentence.endswith("It may also be what was not tried: asymmetric friction.")


def test_where_nothing_was_withheld_nothing_is_held_back(found: Diagnosis) -> None:
    assert beside_untried(found, ()) is found


def test_many_withheld_effects_are_counted(found: Diagnosis) -> None:
    told = beside_untried(found, ["backlash", "hysteresis", "compliance", "lost_frames"])
    assert told.sentence.endswith("any of 4 other effects of the catalogue.")


def test_what_is_in_doubt_already_stays_so(found: Diagnosis) -> None:
    again = beside_untried(found, ["asymmetric_friction"])
    assert again.effects[0].probability == pytest.approx(found.effects[0].probability)
