"""References whose calibration leaves a later run unexplained, though the rig file's own twin fits it."""

import sys
from dataclasses import replace
from types import SimpleNamespace

import pytest

from hil.configfile import load_rig
from hil.gap import diagnose
from hil.gap.located.result import Located
from tests.gap.twin_runs import effect, record

AXIS = load_rig("axis")


@pytest.fixture
def healthy():
    return diagnose(record(), AXIS)


@pytest.mark.parametrize(
    ("beside", "alone", "verdict", "is_told"),
    [
        ("unknown", "no_gap", "no_gap", True),
        ("unknown", "unknown", "unknown", False),
        ("identified", "no_gap", "identified", False),
    ],
)
def test_what_only_references_make_and_nothing_explains_is_no_gap(
    monkeypatch, healthy, beside, alone, verdict, is_told
):
    """A platform's chirp had left its slide two deviations late; the run beside it stood 1.8 floors off."""

    class Answered:
        rig = AXIS

        def __init__(self, verdict):
            self.verdict = verdict

        def answer(self, seed):
            del seed
            return replace(healthy, verdict=self.verdict)

    def consider(runs, rig, *, references=(), **_):
        return Answered(beside if references else alone)

    monkeypatch.setattr(sys.modules["hil.gap.diagnose"], "consider", consider)
    found = diagnose(record(), AXIS, references=[record(seed=2)])
    assert found.verdict == verdict
    assert isinstance(found.located, Located)
    assert bool([f for f in found.located.findings if f.subject == "references"]) == is_told


def test_runs_that_stand_far_off_the_rig_files_own_twin_are_not_asked_again(monkeypatch):
    """That doubles the time of a diagnosis, and no calibration of another day explains so much."""
    asked = []
    unknown = SimpleNamespace(verdict="unknown")

    def consider(runs, rig, **_):
        asked.append(rig)
        return SimpleNamespace(rig=AXIS, answer=lambda seed: unknown)

    monkeypatch.setattr(sys.modules["hil.gap.diagnose"], "consider", consider)
    drags = record(effect("coulomb_friction", force=60.0))
    assert diagnose(drags, AXIS, references=[record(seed=2)]) is unknown
    assert len(asked) == 1
