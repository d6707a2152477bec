"""Effects whose cost is rugged are found from afar: the swing of a spring, a flank some micrometres away."""

from __future__ import annotations

import pytest

from hil.gap import diagnose
from hil.gap.fits.about import about
from hil.sim.parameters import ParameterTable
from tests.gap.twin_runs import AXIS, effect, record

STIFFNESS = 1.3e5


def test_a_spring_that_swings_between_the_starts_is_found() -> None:
    found = diagnose(record(effect("compliance", stiffness=STIFFNESS, damping=400.0)), AXIS)
    assert [x.effect for x in found.effects] == ["compliance"]
    parameters = found.effects[0].parameters
    assert parameters["stiffness"].value == pytest.approx(STIFFNESS, rel=0.05)
    assert parameters["damping"].value == pytest.approx(400.0, rel=0.3)


def test_a_spring_that_stiffens_and_swings_far_is_found() -> None:
    spring = effect("compliance", stiffness=9e4, damping=250.0, hardening=0.5)
    found = diagnose(record(spring, duration_s=12.0), AXIS)
    assert [x.effect for x in found.effects] == ["compliance"]
    assert found.effects[0].parameters["stiffness"].value == pytest.approx(9e4, rel=0.15)


@pytest.mark.parametrize("knee", [0.0, 0.3])
def test_a_limit_is_found_whether_it_cuts_off_or_bends(knee: float) -> None:
    found = diagnose(record(effect("velocity_saturation", limit=0.115, knee=knee)), AXIS)
    assert found.verdict == "identified"
    (limit,) = found.effects
    assert limit.effect == "velocity_saturation"
    assert limit.parameters["limit"].value == pytest.approx(0.115, rel=0.01)
    assert limit.parameters["knee"].value == pytest.approx(knee, abs=0.08)
    assert not limit.parameters["knee"].at_bound


def test_starts_about_a_start_move_nothing_but_what_is_rugged() -> None:
    table = ParameterTable(AXIS)
    vector = table.vector({"axis.backlash.gap": 2e-5})
    rows = about(table, {"axis.backlash.gap": 2e-5}, vector)
    gap = table.index("axis.backlash.gap")
    assert rows[:, gap].min() < 1.3e-5
    assert rows[:, gap].max() == pytest.approx(3e-5)
    rows[:, gap] = vector[gap]
    assert (rows == vector).all()
    assert not len(about(table, {"axis.coulomb_friction.force": 5.0}, vector))
