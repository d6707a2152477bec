"""Twins that are tried on a record which the rig file's own has found sound."""

import importlib

import pytest

from hil.errors import IdentificationError
from hil.gap import locate
from hil.gap.located.sanity import Finding
from hil.gap.record.missing import Missing
from hil.gap.record.runs import as_runs
from hil.gap.rounds.question import Question
from tests.gap.twin_runs import AXIS, record


def test_a_twin_beside_which_a_record_makes_no_sense_is_a_wrong_twin_and_no_refusal(monkeypatch):
    where = importlib.import_module("hil.gap.located.locate")
    strange = [Finding("error", "axis.force", "is it in kN?"), Finding("warning", "imu", "drifts")]
    monkeypatch.setattr(where, "check_answers", lambda problem: strange)
    runs = tuple(as_runs(record(), AXIS))
    with pytest.raises(IdentificationError, match="is it in kN"):
        locate(runs, AXIS)
    found = Question(runs, (), 0, lambda _: None, Missing()).locate(AXIS)
    assert [f for f in found.findings if f in strange] == strange[1:]
