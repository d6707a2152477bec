"""What any rig has, a twin has too: no finding by itself, and what else there is, is seen beside it."""

import numpy as np
import pytest

from hil.gap import diagnose
from tests.gap.twin_runs import AXIS, effect, record
from tests.whole.test_missing import without_rows

FINE = AXIS.model_copy(
    update={"noise": AXIS.noise.model_copy(update={"position": 1e-6, "position_step": 1e-7})}
)
STIFF = effect("compliance", stiffness=2e7, damping=3e3)
WOBBLE = effect("lead_error", amplitude=6e-6, period=0.005, phase=1.0)
RUBS = effect("coulomb_friction", force=25.0)


@pytest.mark.parametrize("usual", [STIFF, WOBBLE])
def test_a_stiff_spring_and_a_screw_that_wobbles_hide_no_friction(usual):
    found = diagnose(record(usual, RUBS, rig=FINE), FINE)
    assert [(x.effect, x.location) for x in found.effects] == [("coulomb_friction", "axis")]
    assert found.effects[0].parameters["force"].value == pytest.approx(25.0, rel=0.1)
    told = next(x.text for x in found.located.findings if x.subject == "twin")
    assert usual.effect.replace("_", " ") in told


def test_a_stiff_spring_alone_is_no_gap():
    assert diagnose(record(STIFF, rig=FINE), FINE).verdict == "no_gap"


def test_a_bus_that_loses_answers_is_named_beside_what_nothing_explains():
    frame = record()
    told = frame[["t", "axis.position"]].dropna()
    place_m = np.interp(frame["t"], told["t"], told["axis.position"])
    swelling = 60.0 * (1.0 + 7.0 * place_m) * np.sin(2.0 * np.pi * place_m / 0.012)
    frame["axis.force"] += swelling
    assert diagnose(frame, AXIS).verdict == "unknown"
    found = diagnose(without_rows(frame, 0.05), AXIS)
    assert [(x.effect, x.location) for x in found.effects] == [("lost_frames", "bus")]
    assert found.effects[0].probability < 0.9
    assert "nothing in the catalogue explains" in found.sentence
