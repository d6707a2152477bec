"""Rides of another world: a perfect bicycle is the model, cases are sealed and the same each time."""

import hashlib

import numpy as np
import pandas as pd
import pytest
from benchmarks.other_rides.bicycle import draw_bicycle, draw_outing
from benchmarks.other_rides.case import Case, Run, draw, write
from benchmarks.other_rides.check import ideal_rides, physical_effects
from benchmarks.other_rides.deck import cards
from benchmarks.other_rides.outside import MAKERS

from hil.bicycle.recorded import prepare
from hil.configfile import find_rig_file, load_bicycle
from hil.exam.case import load_case, read_answer, seal, seals_of
from hil.gap.bicycle import diagnose_rides
from hil.gap.bicycle.roundness import once_a_turn

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


@pytest.mark.parametrize(
    ("fault", "size", "told"),
    [
        (None, 0.0, None),
        ("wheel_out_of_round", 0.002, ("out of round", 2.0)),
        ("wheel_magnet_off_centre", 0.006, ("encoder is off centre", 6.0)),
    ],
)
def test_what_beats_once_a_turn_of_a_wheel_is_told_in_its_size(tmp_path, fault, size, told):
    rng = np.random.default_rng(1777)
    bicycle = draw_bicycle(rng)
    outing = draw_outing("mixed", rng, RIG, bicycle.body)
    for made in (maker(rng) for maker in MAKERS):
        if made.effect == fault:
            bicycle = made.on(bicycle, size)
    answer = {"verdict": "unknown", "effects": []}
    case = Case("ride", 0, (Run(outing, bicycle, "diagnose"),), answer, {})
    write(case, RIG, PATH, tmp_path)
    found = once_a_turn([prepare(run, RIG) for run in load_case(tmp_path / "cases/ride").runs])
    if told is None:
        assert found is None
    else:
        assert told[0] in found
        assert float(found.partition(" by ")[2].split()[0]) == pytest.approx(told[1], rel=0.15)
