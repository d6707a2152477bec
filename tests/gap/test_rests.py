"""Drives that rest for a tick at each setpoint: a healthy rig, not one with viscous friction."""

import numpy as np
import pytest

from hil.gap.diagnose import diagnose
from hil.gap.located.locate import locate
from hil.sim import Twin
from tests.gap.twin_runs import AXIS, effect, record

RESTING = AXIS.model_copy(
    update={"bus": AXIS.bus.model_copy(update={"interpolation": "linear_rests"})}
)


def resting(*effects, seed=1):
    """A record of drives that rest, their force asked for where it no longer swings."""
    return record(*effects, rig=RESTING, seed=seed, asked_s=0.004)


def is_told(found):
    return any(f.subject == "bus.interpolation" for f in found.findings)


def test_the_reference_falls_behind_by_what_the_bus_says():
    sent = np.arange(0.0, 3.0, AXIS.bus.cycle)
    told = 0.02 * sent
    at = np.arange(1.5, 2.5, 0.00025)
    plain, resting = (
        Twin(rig).replay({"axis": (sent, told)}, {"axis.position": at})["axis.position"]
        for rig in (AXIS, RESTING)
    )
    behind_s = float(np.mean(plain - resting)) / 0.02
    assert behind_s == pytest.approx(RESTING.bus.reach_s - AXIS.bus.reach_s, rel=0.02)


def test_a_healthy_rig_whose_drives_rest_has_no_gap_and_the_reader_is_told():
    answer = diagnose(resting(), AXIS)
    assert answer.verdict == "no_gap"
    assert is_told(answer.located)


def test_an_effect_is_named_beside_the_rest():
    answer = diagnose(resting(effect("coulomb_friction", force=40.0)), AXIS)
    assert is_told(answer.located)
    assert [(x.effect, x.location) for x in answer.effects] == [("coulomb_friction", "axis")]


def test_a_rest_of_the_references_is_one_of_the_run():
    run = resting(effect("coulomb_friction", force=40.0), seed=2)
    answer = diagnose(run, AXIS, references=resting())
    assert is_told(answer.located)
    assert answer.located.evidence.problem.rig.bus.interpolation == "linear_rests"
    assert [(x.effect, x.location) for x in answer.effects] == [("coulomb_friction", "axis")]


@pytest.mark.parametrize(
    "what",
    [
        effect("viscous_friction", coefficient=900.0),
        effect("transport_delay", delay=0.0011),
        effect("loop_gain", position=0.92),
    ],
    ids=lambda e: e.effect,
)
def test_what_looks_like_a_rest_is_not_taken_for_one(what):
    assert not is_told(locate(record(what), AXIS))
