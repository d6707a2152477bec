"""What is judged and what is held out: no forces at rest, and always something for fits to go by."""

from types import SimpleNamespace

import numpy as np
import pytest

from hil.gap import diagnose, locate
from hil.gap.fits.heldout import split
from hil.gap.floor.noise import autoregression
from hil.gap.located.sanity import check_answers
from hil.gap.record.problem import Problem, Series
from hil.gap.record.runs import as_runs
from hil.gap.record.standstill import at_rest
from hil.identify.replay import Stretch, stretches
from tests.gap.twin_runs import AXIS, effect, record


def ramp_and_hold(mode="position"):
    """Two seconds at 10 mm/s, three at rest, one on the way back."""
    sent = np.arange(0.0, 6.0, 0.01)
    told = np.interp(sent, [0.0, 2.0, 5.0, 6.0], [0.0, 0.02, 0.02, 0.01])
    return Stretch("run", {"axis": (sent, told)}, {}, mode)


def test_forces_at_rest_are_those_after_braking_until_friction_has_turned():
    t = np.linspace(0.0, 6.0, 601)
    resting = at_rest(ramp_and_hold(), "axis", t)
    assert resting[(t > 2.05) & (t < 5.05)].all()  # half a millimetre at 10 mm/s
    assert not resting[((t > 0.06) & (t < 2.02)) | (t > 5.07)].any()


def test_a_reversal_is_no_rest():
    sent = np.arange(0.0, 4.0, 0.01)
    told = np.interp(sent, [0.0, 2.0, 2.05, 4.0], [0.0, 0.02, 0.02, 0.0])
    t = np.linspace(0.1, 4.0, 391)
    assert not at_rest(Stretch("run", {"axis": (sent, told)}, {}, "position"), "axis", t).any()


def test_forces_that_are_commanded_are_judged_at_rest_too():
    assert not at_rest(ramp_and_hold("force"), "axis", np.linspace(0.0, 6.0, 601)).any()


@pytest.fixture(scope="module")
def held_still():
    """A healthy record that ends with three seconds of rest in which friction lets its force go."""
    run = record()
    still = run["t"] > 11.0
    told = run.loc[run["t"] <= 11.0, "axis.setpoint"].dropna().iloc[-1]
    out = run.copy()
    out.loc[still & run["axis.setpoint"].notna(), "axis.setpoint"] = told
    out.loc[still & run["axis.position"].notna(), "axis.position"] = told
    out.loc[still & run["axis.force"].notna(), "axis.force"] = 0.0
    return out


def test_what_friction_does_with_force_at_rest_is_no_gap(held_still):
    before = held_still[held_still["t"] < 11.0]
    problem = locate(held_still, AXIS).evidence.problem
    force = next(x.part for x in problem.series if x.quantity == "force")
    late = problem.t_s[force] > 11.5
    assert not problem.kept[force][late].any()
    assert problem.kept[force][~late].sum() > 0.8 * before["axis.force"].notna().sum() - 100


def test_of_a_lone_run_the_end_is_held_out_or_the_beginning_where_all_of_the_gap_is_at_the_end():
    found = locate(record(effect("coulomb_friction", force=60.0)), AXIS)
    e = found.evidence
    assert split(e.problem, e.noise, e.residual).text.startswith("the last")
    start, end = e.problem.pieces[0].span_s
    late = e.problem.t_s > start + 0.7 * (end - start)
    only_late = np.where(late, e.residual, e.noise.draws[0])
    parts = split(e.problem, e.noise, only_late)
    assert parts.text.startswith("the first")
    assert parts.train(e.problem)[late].all()


def test_of_several_runs_the_one_with_all_of_the_gap_is_never_held_out():
    runs = [record(seed=2), record(effect("coulomb_friction", force=60.0), seed=3)]
    found = diagnose(runs, AXIS)
    assert found.verdict != "no_gap"
    assert (found.causes[0].effect, found.causes[0].location) == ("coulomb_friction", "axis")


def test_a_signal_without_a_judged_sample_has_no_autoregression():
    terms, gain = autoregression(np.empty((6, 0)))
    assert (len(terms), gain) == (0, 1.0)


def test_a_signal_is_called_late_where_it_is_and_friction_is_no_lateness():
    def said(*effects):
        (run,) = as_runs(record(*effects), AXIS)
        return [f.subject for f in check_answers(Problem(AXIS, stretches(run)))]

    assert said(effect("sensor_latency", "axis.position", delay=0.01)) == ["axis.position"]
    assert said(effect("coulomb_friction", force=30.0)) == []


def test_what_lies_below_its_floor_takes_nothing_off_the_gap_that_fits_must_see():
    """Of two runs the second has all of the gap, in one signal; another lies far below its floors."""
    t = np.arange(0.0, 10.0, 0.01)
    count = len(t)
    parts = [slice(k * count, (k + 1) * count) for k in range(4)]
    series = [Series(s, k, parts[2 * k + j]) for k in (0, 1) for j, s in enumerate("ab")]
    residual = np.concatenate([np.full(count, x) for x in (1.0, 0.1, 3.0, 0.1)])
    floors = np.concatenate([np.full(count, x) for x in (1.0, 9.0, 1.0, 9.0)])
    pieces = [SimpleNamespace(name=f"run{k}", span_s=(0.0, 10.0)) for k in (1, 2)]
    problem = SimpleNamespace(
        pieces=pieces, series=series, size=4 * count, t_s=np.tile(t, 4),
        kept=np.ones(4 * count, dtype=bool),
    )  # fmt: skip
    noise = SimpleNamespace(sigma=np.ones(4 * count), draws=floors[None, :], tamed=lambda _, r: r)
    assert split(problem, noise, residual).text == "run1"
