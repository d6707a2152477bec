"""What changes do is told by a twin with longer ticks, where that tells as much."""

from __future__ import annotations

import numpy as np
import pytest

from hil.gap.floor.noise import find_noise
from hil.gap.record.coarse import coarser
from hil.gap.record.problem import Problem
from hil.gap.record.runs import as_runs
from hil.identify.replay import stretches
from tests.gap.twin_runs import AXIS, record

MOVED = {
    "axis.coulomb_friction.force": 20.0,
    "axis.viscous_friction.coefficient": 200.0,
    "axis.hysteresis.force": 20.0,
    "axis.force_ripple.amplitude": 20.0,
    "axis.force_constant.scale": 0.9,
    "axis.loop_gain.position": 0.8,
    "axis.transport_delay.delay": 2e-3,
    "axis.lead_error.scale": 1.002,
    "axis.actuator_inertia.mass": 20.0,
    "platform.payload_mass.mass": 40.0,
}
AS_THEY_ARE = {
    "axis.force.sensor_latency.delay": 2e-3,
    "axis.backlash.gap": 3e-4,
    "axis.compliance.stiffness": 1e6,
    "drives.clock_drift.rate": 1e-4,
}


@pytest.fixture(scope="module")
def problem() -> Problem:
    (run,) = as_runs(record(duration_s=8.0), AXIS)
    return Problem(AXIS, stretches(run))


def changed(problem: Problem, values: dict[str, float]) -> tuple[np.ndarray, np.ndarray]:
    """(B, N) what each value changes by itself: as told by `changes`, and of the twin as it is."""
    rows = np.tile(problem.base, (len(values), 1))
    for row, (name, value) in zip(rows, values.items(), strict=True):
        row[problem.table.index(name)] = value
    base = problem.answers(problem.base)[0]
    return problem.changes(rows, problem.base, base), problem.answers(rows) - base


def test_longer_ticks_tell_what_an_effect_does(problem: Problem) -> None:
    noise = find_noise(problem, problem.base, np.random.default_rng(0), count=2)
    for name, told, true in zip(MOVED, *changed(problem, MOVED), strict=True):
        white, whole = (noise.whiten(problem, x) for x in (told - true, true))
        assert 0.0 < np.linalg.norm(white) < 0.1 * np.linalg.norm(whole), name


def test_springs_play_and_what_is_late_by_less_than_a_tick_are_told_by_the_twin_as_it_is(
    problem: Problem,
) -> None:
    told, true = changed(problem, AS_THEY_ARE)
    np.testing.assert_array_equal(told, true)


def test_ticks_are_longer_by_whole_numbers_within_those_of_the_position_loop() -> None:
    slower = coarser(AXIS)
    assert slower is not None
    assert slower.bus.speed_loop == pytest.approx(2.0 * AXIS.bus.speed_loop)
    assert slower.bus.position_loop == AXIS.bus.position_loop
    one_loop = AXIS.bus.model_copy(update={"position_loop": AXIS.bus.speed_loop})
    assert coarser(AXIS.model_copy(update={"bus": one_loop})) is None


def test_where_loops_are_so_hard_that_ticks_show_they_stay_as_they_are() -> None:
    (drive,) = AXIS.actuators
    hard = drive.model_copy(update={"speed_gain": 600.0 * drive.effective_mass})
    assert coarser(AXIS.model_copy(update={"actuators": (hard,)})) is None
