"""A spring that moves the kicks by which ticks are found."""

import pytest

from hil.gap import diagnose
from hil.gap.record.arrivals import find_clocks
from hil.gap.record.problem import Problem
from hil.gap.record.runs import as_runs
from hil.identify.replay import stretches
from tests.gap.twin_runs import AXIS, effect, jittered

SPRING = effect("compliance", stiffness=8e5, damping=300.0)


def test_ticks_that_a_spring_puts_half_a_tick_off_are_found_beside_it():
    (run,) = as_runs(jittered(SPRING, seed=5), AXIS)
    problem = Problem(AXIS, stretches(run))
    (off,) = find_clocks(problem).values()
    (clock,) = find_clocks(problem, problem.table.from_effects((SPRING,))).values()
    tick_s = AXIS.bus.position_loop
    assert abs(off.phase_s - 0.5 * tick_s) < 0.2 * tick_s
    assert abs((clock.phase_s + 0.5 * tick_s) % tick_s - 0.5 * tick_s) < 0.05 * tick_s


def test_such_a_spring_is_named():
    found = diagnose(jittered(SPRING, seed=5), AXIS)
    (cause,) = found.effects
    assert cause.effect == "compliance"
    assert cause.parameters["stiffness"].value == pytest.approx(8e5, rel=0.1)
    assert found.score.shrink > 0.9
