"""A position that is ahead of its own setpoint."""

import pytest

from hil.errors import IdentificationError
from hil.gap import locate
from hil.gap.located.sanity import check_answers
from hil.gap.record.problem import Problem
from hil.gap.record.runs import as_runs
from hil.identify.replay import stretches
from tests.gap.twin_runs import AXIS, effect, record


def test_exchanged_columns_are_refused():
    frame = record()
    swapped = frame.rename(
        columns={"axis.setpoint": "axis.position", "axis.position": "axis.setpoint"}
    )
    with pytest.raises(
        IdentificationError, match=r"axis.position: comes \d+.\d ms before its own setpoint"
    ):
        locate(swapped, AXIS)


def test_answers_whose_clock_runs_off_are_not():
    drifting = record(effect("clock_drift", "drives", rate=-0.004))
    (run,) = as_runs(drifting, AXIS)
    findings = check_answers(Problem(AXIS, stretches(run)))
    assert not any(f.severity == "error" for f in findings)
