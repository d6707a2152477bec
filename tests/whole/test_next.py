"""The next experiment: it tells apart what the diagnosis could not, within the limits, and can be played."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from hil.cli.experiment import app as experiment
from hil.cli.gap import app as gap
from hil.configfile import load_rig
from hil.control.trajectory import check
from hil.errors import IdentificationError
from hil.gap.next import (
    draw_sketches,
    generic_multisine,
    propose,
    read_candidates,
    split_of,
)
from hil.gap.next.score import payloads_of, recorded
from hil.identify.experiments import read_experiment
from hil.rigs import build_rig
from hil.runs.folder import read_meta

SIGNALS = ("axis.position", "axis.force")


def diagnosis(causes: dict[str, dict[str, float]], verdict: str = "ambiguous") -> dict[str, Any]:
    """An answer file with equally probable causes in one class."""
    rows = []
    for name, parameters in causes.items():
        location, effect = name.rsplit(".", 1)
        values = {k: {"value": v} for k, v in parameters.items()}
        rows.append({"effect": effect, "location": location, "probability": 1.0 / len(causes),
                     "class": 0, "parameters": values})  # fmt: skip
    return {"format": "hil-diagnosis/1", "rig": "axis", "verdict": verdict, "causes": rows,
            "effects": rows[:1], "gap": {"signals": {s: {} for s in SIGNALS}}}  # fmt: skip


GAP_OR_FRICTION = diagnosis(
    {"axis.backlash": {"gap": 3e-4}, "axis.coulomb_friction": {"force": 15.0}}
)
MASS_OR_GAIN = diagnosis(
    {"platform.payload_mass": {"mass": 20.0}, "axis.force_constant": {"scale": 0.86}}
)
MASS_OR_INERTIA = diagnosis(
    {"platform.payload_mass": {"mass": 10.0}, "axis.actuator_inertia": {"mass": 10.0}}
)


@pytest.mark.parametrize(
    ("pattern", "shares"),
    [
        (("position", "force"), {"axis.position": 1 / 2, "axis.force": 1 / 2}),
        (("position", "force", "force"), {"axis.position": 1 / 3, "axis.force": 2 / 3}),
    ],
)
def test_a_motion_is_recorded_as_often_as_the_slots_ask(
    pattern: tuple[str, ...], shares: dict[str, float]
) -> None:
    rig = load_rig("axis")
    rig = rig.model_copy(update={"bus": rig.bus.model_copy(update={"pattern": pattern})})
    rng = np.random.default_rng(4)
    sketch = draw_sketches(rig, 20.0, 6, rng)[0]
    stretch = recorded(sketch, rig, SIGNALS, rng)[0]
    sent = len(stretch.setpoints["axis"][0])
    for signal, share in shares.items():
        assert len(stretch.samples[signal][0]) == pytest.approx(share * sent, abs=1)


def test_every_motion_that_is_drawn_keeps_the_rigs_limits() -> None:
    rig = load_rig("axis")
    manipulator = build_rig(rig)
    drawn = draw_sketches(rig, 20.0, 12, np.random.default_rng(3))
    assert len(drawn) >= 10
    assert len({s.kind for s in drawn}) >= 4
    for sketch in drawn:
        assert not check(sketch.trajectory, rig, manipulator), sketch.text
        assert np.allclose(sketch.trajectory.poses[[0, -1]], 0.0, atol=1e-9)


def test_the_motion_that_it_proposes_moves_and_says_what_it_splits() -> None:
    rig = load_rig("axis")
    found = propose(GAP_OR_FRICTION, rig, seconds=9.0, count=3, seed=1).table()
    assert found["splits"] == [["backlash at axis", "coulomb friction at axis"]]
    assert found["expected_probability"] > 0.95
    assert found["payload"] is None
    assert found["sentence"].startswith("Play ")


def test_payloads_are_asked_for_that_the_drives_can_carry() -> None:
    rig = load_rig("axis")
    light, heavy = payloads_of(rig)
    assert 0.0 < light < heavy < 0.5 * rig.mass.m
    candidates, shared = read_candidates(MASS_OR_GAIN, rig)
    plain = generic_multisine(rig, 12.0)
    splits = [
        split_of(replace(plain, payload_kg=kg), rig, candidates, shared, SIGNALS)
        for kg in (heavy, 40.0 * rig.mass.m)
    ]
    assert splits[0] is not None
    assert splits[1] is None
    alone = split_of(plain, rig, candidates, shared, SIGNALS)
    assert alone is not None
    assert splits[0].right > alone.right


def test_what_acts_alike_in_any_motion_is_not_promised_to_be_split() -> None:
    rig = load_rig("axis")
    candidates, shared = read_candidates(MASS_OR_INERTIA, rig)
    split = split_of(generic_multisine(rig, 12.0), rig, candidates, shared, SIGNALS)
    assert split is not None
    assert split.apart() == []
    assert split.right == pytest.approx(0.5, abs=0.02)


@pytest.mark.parametrize(
    ("tables", "says"),
    [
        ({"format": "other"}, "no diagnosis"),
        ({**GAP_OR_FRICTION, "rig": "stewart"}, "of stewart"),
        ({**GAP_OR_FRICTION, "causes": GAP_OR_FRICTION["causes"][:1]}, "nothing to tell apart"),
        ({**GAP_OR_FRICTION, "causes": [], "verdict": "no_gap"}, "no_gap"),
    ],
)
def test_a_diagnosis_that_leaves_nothing_open_is_refused(tables: dict[str, Any], says: str) -> None:
    with pytest.raises(IdentificationError, match=says):
        read_candidates(tables, load_rig("axis"))


PLAIN_OR_DIRECTED = {
    "axis.coulomb_friction": {"force": 29.9},
    "axis.asymmetric_friction": {"positive": 29.7, "negative": 30.2},
}


def test_a_law_that_is_a_simpler_one_with_its_values_is_nothing_to_split() -> None:
    with pytest.raises(IdentificationError, match=r"coulomb friction at axis.*the simpler stands"):
        propose(diagnosis(PLAIN_OR_DIRECTED), load_rig("axis"), seconds=9.0, count=2, seed=1)


def test_a_law_whose_values_are_no_simpler_ones_is_split_from_it() -> None:
    sides = {**PLAIN_OR_DIRECTED, "axis.asymmetric_friction": {"positive": 60.0, "negative": 0.0}}
    found = propose(diagnosis(sides), load_rig("axis"), seconds=9.0, count=2, seed=1).table()
    assert found["splits"] == [["coulomb friction at axis", "asymmetric friction at axis"]]
    assert "the simpler stands" not in found["sentence"]


def test_beside_other_candidates_the_simpler_of_two_alike_laws_stands() -> None:
    three = {**PLAIN_OR_DIRECTED, "axis.backlash": {"gap": 3e-4}}
    found = propose(diagnosis(three), load_rig("axis"), seconds=9.0, count=2, seed=1)
    assert "asymmetric friction at axis is coulomb friction at axis where nothing" in found.sentence


def test_the_command_writes_what_hil_experiment_plays(tmp_path: Path) -> None:
    answer, out = tmp_path / "diagnosis.json", tmp_path / "next.toml"
    answer.write_text(json.dumps(GAP_OR_FRICTION), encoding="utf-8")
    options = ["--rig", "axis", "--out", str(out), "--seconds", "8", "--count", "1", "--json"]
    run = CliRunner().invoke(gap, ["next", str(answer), *options])
    assert run.exit_code == 0, run.output
    described = read_experiment(out)
    assert described.purpose
    assert described.payload is None
    runs = tmp_path / "runs"
    play = CliRunner().invoke(experiment, ["axis", "play", str(out), "--runs", str(runs), "--json"])
    assert play.exit_code == 0, play.output
    (folder,) = runs.iterdir()
    assert (folder / "experiment.toml").is_file()
    assert read_meta(folder).payload is None
