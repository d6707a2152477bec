"""Cases of the third lab are sealed, the same each time, and what they hold is told."""

import hashlib

import pandas as pd
import pytest
from benchmarks.third_lab.__main__ import write
from benchmarks.third_lab.case import make

from hil.configfile import load_rig
from hil.exam.case import load_case, read_answer, seal, seals_of
from hil.gap import locate

AXIS = load_rig("axis")
HEALTHY = 2
"""Case of seed 1."""


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """The healthy case and the folder that it was written to."""
    out = tmp_path_factory.mktemp("lab")
    return out, write(out, "axis", 1, HEALTHY, make("axis", AXIS, 1, HEALTHY)).name


def test_answers_fit_their_seals(made):
    out, name = made
    told = out / "answers" / name / "answer.json"
    (mark,) = seals_of(out / "cases" / name)
    assert mark in (seal(read_answer(told)), hashlib.sha256(told.read_bytes()).hexdigest())


def test_a_case_is_the_same_each_time(made):
    out, name = made
    again = make("axis", AXIS, 1, HEALTHY)
    for k, record in enumerate(again.records):
        written = pd.read_parquet(out / "cases" / name / f"run{k + 1}" / "signals.parquet")
        pd.testing.assert_frame_equal(record.reset_index(drop=True), written)


def test_no_signal_of_a_healthy_rig_of_a_third_world_stands_above_its_floor(made):
    out, name = made
    case = load_case(out / "cases" / name)
    assert max(s.ratio for s in locate(case.runs, case.rig).signals) < 1.3
