"""Many samples count as one: nuisances follow their priors, not the small ways in which a twin is wrong."""

from __future__ import annotations

import numpy as np
import pytest

from hil.gap.catalogue.nuisances import LIMIT, default_nuisances
from hil.gap.fits.heldout import split
from hil.gap.fits.training import begin, candidates_of
from hil.gap.located.locate import locate
from hil.gap.record.problem import AT_LEAST, ENOUGH, Problem
from hil.gap.record.runs import as_runs
from hil.gap.search.linear import Search
from hil.identify.replay import stretches
from tests.gap.twin_runs import AXIS, effect, record


def problem_of(frame) -> Problem:
    (run,) = as_runs(frame, AXIS)
    return Problem(AXIS, stretches(run))


def strain(found) -> float:
    """Sum of squares of the nuisances, in their priors' deviations."""
    return float(sum((f.change / f.prior_sd) ** 2 for f in found.nuisances))


def test_a_record_counts_as_enough_samples_at_most_and_costs_are_rugged_in_any():
    short, long = problem_of(record()), problem_of(record(duration_s=60.0))
    assert short.discount == AT_LEAST
    assert long.discount == pytest.approx(long.kept.sum() / ENOUGH)


def test_nuisances_do_not_follow_a_twin_that_is_a_little_wrong_everywhere(monkeypatch):
    # a screw that is stiffer than any that would be found: a trace of tenths of a floor
    frame = record(effect("compliance", stiffness=2.5e7, damping=1000.0), duration_s=60.0)
    counted = strain(locate(frame, AXIS))
    monkeypatch.setattr(Problem, "discount", 1.0)
    assert counted < 0.6 * strain(locate(frame, AXIS))
    assert counted < 11.0


def test_proposals_know_how_far_nuisances_may_go():
    """A constant force beside friction: without bounds the friction that is a nuisance would take all."""
    pair = (
        effect("sensor_bias", "axis.force", offset=700.0),
        effect("coulomb_friction", force=300.0),
    )
    e = locate(record(*pair, duration_s=30.0), AXIS).evidence
    nuisances = default_nuisances(AXIS, e.problem.signals)
    c, none = begin(e, split(e.problem, e.noise, e.residual), nuisances, {}, 0)
    search = Search(c, candidates_of(c, none, ()))
    found = {search.bank.leaves[p.leaves[0]].name: p for p in search.alone()}
    bias = found["axis.force.sensor_bias"]
    assert bias.gain > 0.0
    assert np.all(np.abs(bias.z) <= LIMIT)
    assert bias.gain > 0.1 * max(p.gain for p in found.values())
