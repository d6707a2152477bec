"""Cases of the other lab are whole, the same each time, and what they hold is told."""

import hashlib

import numpy as np
import pandas as pd
import pytest
from benchmarks.other_lab.__main__ import STRIDE
from benchmarks.other_lab.cases import draw_case, role_of, write_case

from hil.configfile import find_rig_file, load_rig
from hil.exam.case import load_case, read_answer, seal, seals_of
from hil.gap import diagnose

SEED = 5
AXIS = load_rig("axis")


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """The first healthy case and the first with one effect, and the folder of all."""
    out = tmp_path_factory.mktemp("lab")
    ids = []
    for sort in ("null", "single"):
        index = next(k for k in range(20) if role_of("axis", SEED, k)[0] == sort)
        draft = draw_case(AXIS, SEED, index, STRIDE["axis"])
        write_case(draft, find_rig_file("axis"), out)
        ids.append(draft.id)
    return out, ids


def test_answers_fit_their_seals(made):
    out, ids = made
    for name in ids:
        answer = read_answer(out / "answers" / name / "answer.json")
        (mark,) = seals_of(out / "cases" / name)
        told = (out / "answers" / name / "answer.json").read_bytes()
        assert mark in (seal(answer), hashlib.sha256(told).hexdigest())


def test_a_case_is_the_same_each_time(made, tmp_path):
    out, ids = made
    index = int(ids[0].rpartition("-")[2])
    write_case(draw_case(AXIS, SEED, index, STRIDE["axis"]), find_rig_file("axis"), tmp_path)
    for folder in sorted((out / "cases" / ids[0]).glob("run*")):
        again = tmp_path / "cases" / ids[0] / folder.name / "signals.parquet"
        pd.testing.assert_frame_equal(
            pd.read_parquet(folder / "signals.parquet"), pd.read_parquet(again)
        )


def test_a_healthy_rig_of_another_world_has_no_gap(made):
    out, ids = made
    case = load_case(out / "cases" / ids[0])
    found = diagnose(case.runs, case.rig, references=case.references)
    assert found.verdict == "no_gap"
    assert not found.effects


def test_what_is_asked_is_followed(made):
    out, ids = made
    for run in load_case(out / "cases" / ids[1]).runs:
        told = run.table[["t", "axis.setpoint"]].dropna().to_numpy().T
        at, stood = run.table[["t", "axis.position"]].dropna().to_numpy().T
        late_s = AXIS.bus.cycle + 1.0 / AXIS.actuators[0].position_gain
        apart = stood - np.interp(at - late_s, *told)
        assert np.sqrt(np.mean(apart**2)) < 0.1 * np.std(told[1])
