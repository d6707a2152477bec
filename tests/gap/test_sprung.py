"""Transmissions that give a little, as every healthy one does, are no finding; soft ones are."""

import math

from hil.gap.diagnose import diagnose
from tests.gap.twin_runs import AXIS, effect, record

QUIET = AXIS.model_copy(
    update={"noise": AXIS.noise.model_copy(update={"force": 1.0, "force_step": 0.5})}
)
"""A drive whose current is quiet enough to show it."""


def spring(stiffness):
    damping = 0.1 * math.sqrt(stiffness * AXIS.mass.m)
    return effect("compliance", stiffness=stiffness, damping=damping)


def test_a_screw_of_forty_newtons_a_micrometre_is_healthy():
    told = []
    answer = diagnose(record(spring(4e7), rig=QUIET, share=1.8), QUIET, report=told.append)
    assert any("transmissions" in line for line in told)
    assert answer.verdict == "no_gap"


def test_a_screw_of_three_newtons_a_micrometre_is_not():
    answer = diagnose(record(spring(3e6), rig=QUIET), QUIET)
    assert [(x.effect, x.location) for x in answer.effects] == [("compliance", "axis")]
    stiffness = answer.effects[0].parameters["stiffness"].value
    assert 2.5e6 < stiffness < 3.5e6
