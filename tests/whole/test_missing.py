"""Answers that never came: told by the slots that they left empty, and by nothing that looks a little so."""

import numpy as np
import pandas as pd
import pytest

from hil.gap import diagnose
from hil.gap.record.missing import missing_answers
from hil.gap.record.runs import as_runs
from tests.gap.twin_runs import AXIS, record

RNG = np.random.default_rng(5)


def without_rows(frame: pd.DataFrame, share: float, *, setpoints: bool = False) -> pd.DataFrame:
    """`frame` without a share of its rows of answers, or of whole cycles, setpoint and answer."""
    lost = RNG.uniform(size=len(frame)) < share
    if setpoints:
        cycle = np.floor(frame["t"].to_numpy() / AXIS.bus.cycle).astype(int)
        lost = (RNG.uniform(size=cycle.max() + 1) < share)[cycle]
    else:
        lost &= frame["axis.setpoint"].isna().to_numpy()
    return frame[~lost].reset_index(drop=True)


def missing_of(frame: pd.DataFrame, *references: pd.DataFrame):
    return missing_answers(as_runs(frame, AXIS), as_runs(references, AXIS))


@pytest.fixture(scope="module")
def healthy() -> pd.DataFrame:
    return record()


def test_answers_that_are_missing_are_counted_by_their_slots(healthy):
    assert missing_of(healthy).count == 0
    found = missing_of(without_rows(healthy, 0.05))
    assert found.is_finding
    assert found.share == pytest.approx(0.05, abs=0.015)


def test_a_drive_may_be_asked_for_one_signal_twice_in_a_row(healthy):
    cycles = np.floor(healthy["t"].to_numpy() / AXIS.bus.cycle).astype(int)
    answers = healthy["axis.setpoint"].isna().to_numpy()
    frame = healthy.copy()
    frame["axis.force"] = np.where(answers & (cycles % 3 > 0), 1.0, np.nan)
    frame["axis.position"] = np.where(answers & (cycles % 3 == 0), 0.1, np.nan)
    assert missing_of(frame).count == 0
    assert missing_of(without_rows(frame, 0.05)).share == pytest.approx(0.05, abs=0.015)


def test_cycles_that_the_host_left_out_and_holes_are_no_answers_that_are_missing(healthy):
    assert not missing_of(without_rows(healthy, 0.05, setpoints=True)).is_finding
    t = healthy["t"]
    hole = healthy[~t.between(6.0, 6.6) | healthy["axis.setpoint"].notna()]
    assert not missing_of(hole.reset_index(drop=True)).is_finding


def test_what_references_lack_as_well_is_no_finding(healthy):
    old = without_rows(record(seed=2), 0.05)
    assert not missing_of(without_rows(healthy, 0.05), old).is_finding
    assert missing_of(without_rows(healthy, 0.2), old).is_finding


def test_a_bus_that_loses_answers_is_named_and_nothing_else(healthy):
    found = diagnose(without_rows(healthy, 0.05), AXIS)
    assert found.verdict == "identified"
    assert [(x.effect, x.location) for x in found.effects] == [("lost_frames", "bus")]
    (cause,) = found.effects
    assert cause.parameters["answers"].value == pytest.approx(0.05, abs=0.015)
    assert "% never came" in found.sentence
    assert diagnose(without_rows(healthy, 0.05), AXIS, without=("lost_frames",)).verdict == "no_gap"
