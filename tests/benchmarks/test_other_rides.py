"""Rides of another world: a perfect bicycle is the model, cases are sealed and the same each time."""

import hashlib

import pandas as pd
import pytest
from benchmarks.other_rides.case import draw, write
from benchmarks.other_rides.check import ideal_rides, physical_effects
from benchmarks.other_rides.deck import cards

from hil.configfile import find_rig_file, load_bicycle
from hil.exam.case import load_case, read_answer, seal, seals_of
from hil.gap.bicycle import diagnose_rides

PATH = find_rig_file("bicycle")
RIG = load_bicycle(PATH)
HEALTHY = 6
"""Case of seed 1: tight lane changes, speeds that change, a floor that is not even."""


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """The healthy case and the folder that it was written to."""
    out = tmp_path_factory.mktemp("rides")
    case = draw(RIG, 1, HEALTHY, cards(1, HEALTHY)[HEALTHY])
    write(case, RIG, PATH, out)
    return out, case.name


def test_a_perfect_bicycle_of_another_derivation_is_the_model():
    assert all(ideal_rides(RIG))
    assert all(physical_effects(RIG))


def test_answers_fit_their_seals(made):
    out, name = made
    told = out / "answers" / name / "answer.json"
    (mark,) = seals_of(out / "cases" / name)
    assert mark in (seal(read_answer(told)), hashlib.sha256(told.read_bytes()).hexdigest())


def test_a_case_is_the_same_each_time(made, tmp_path):
    out, name = made
    write(draw(RIG, 1, HEALTHY, cards(1, HEALTHY)[HEALTHY]), RIG, PATH, tmp_path)
    for folder in sorted((out / "cases" / name).glob("run*")):
        again = tmp_path / "cases" / name / folder.name / "signals.parquet"
        pd.testing.assert_frame_equal(
            pd.read_parquet(folder / "signals.parquet"), pd.read_parquet(again)
        )


def test_a_healthy_bicycle_on_a_floor_that_is_not_even_has_no_gap(made):
    out, name = made
    case = load_case(out / "cases" / name)
    assert diagnose_rides(case.runs, case.rig, references=case.references).verdict == "no_gap"
