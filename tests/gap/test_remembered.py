"""What was asked a moment ago is not computed again, and is what it would be."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from hil.bicycle.path import slalom
from hil.bicycle.recorded import Ride
from hil.bicycle.simulated import simulate_ride
from hil.configfile import load_bicycle
from hil.gap.bicycle import RideProblem
from hil.gap.bicycle.twin import RideTwin
from hil.gap.record.problem import Problem
from hil.gap.record.runs import as_runs
from hil.gap.record.ticks import Ticks
from hil.identify.replay import stretches
from hil.sim.twin import Replay
from tests.bicycle.rides import ride_of
from tests.gap.twin_runs import AXIS, record

BICYCLE = load_bicycle("bicycle")


@pytest.fixture(scope="module")
def problem() -> Problem:
    (run,) = as_runs(record(duration_s=4.0, seed=901), AXIS)
    return Problem(AXIS, stretches(run))


@pytest.fixture
def replays(monkeypatch: pytest.MonkeyPatch) -> list[Replay]:
    """Every replay that is made."""
    made: list[Replay] = []
    run = Replay.run

    def counted(job: Replay, parameters: np.ndarray | None = None) -> np.ndarray:
        made.append(job)
        return run(job, parameters)

    monkeypatch.setattr(Replay, "run", counted)
    return made


def test_the_same_question_is_replayed_once(problem: Problem, replays: list[Replay]) -> None:
    vector = np.array(problem.base)
    vector[problem.table.index("axis.viscous_friction.coefficient")] += 123.0
    first = problem.answers(vector)
    again = Problem(AXIS, problem.sent).answers(np.array([vector, problem.base]))
    assert len(replays) == 2
    assert np.array_equal(first[0], again[0])
    assert not np.array_equal(again[0], again[1])
    first[0] = 0.0
    assert np.array_equal(problem.answers(vector)[0], again[0])


def test_other_ticks_are_another_question(problem: Problem, replays: list[Replay]) -> None:
    vector = np.array(problem.base)
    vector[problem.table.index("axis.viscous_friction.coefficient")] += 321.0
    usual = problem.answers(vector)
    ticked = problem.with_clocks({(0, "axis"): Ticks(3e-4, 0.0, 0.0)}).answers(vector)
    assert len(replays) == 2
    assert not np.array_equal(usual, ticked)


@pytest.fixture(scope="module")
def ride() -> Ride:
    return ride_of(simulate_ride(BICYCLE, slalom(40.0, 10.0, 2.0), 5, cruise=4.5, turning=4.5))


def test_a_ride_answers_the_same_whatever_was_asked_before(ride: Ride) -> None:
    """For each parameter, beside answers to all the others: also those that change no motion."""
    problem = RideProblem(BICYCLE, [ride])
    (twin,) = problem.twins

    def of(built: RideTwin, vector: np.ndarray) -> np.ndarray:
        answer = built.answer(problem.values(vector))
        return np.concatenate([answer[s] for s in built.signals])

    usual = of(twin, problem.base)
    told = []
    for k, p in enumerate(problem.table.entries):
        row = np.array(problem.base)
        step = p.search_step if p.to_search(row[k]) + p.search_step <= p.upper else -p.search_step
        row[k] = p.from_search(p.to_search(row[k]) + step)
        mine, alone = of(twin, row), of(replace(twin), row)
        assert np.array_equal(mine, alone), p.name
        told.append(not np.array_equal(mine, usual))
    assert sum(told) > 30
