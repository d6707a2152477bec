"""The twin with its nuisances refitted: from where they are thought to be, and no further than that lets."""

from __future__ import annotations

import numpy as np
import pytest

from hil.gap.catalogue.nuisances import Nuisance
from hil.gap.floor.noise import find_noise
from hil.gap.located.locate import locate
from hil.gap.located.residual import refit
from hil.gap.located.result import Located
from tests.gap.twin_runs import AXIS, effect, record

MASS = "platform.payload_mass.mass"


@pytest.fixture(scope="module")
def heavier() -> Located:
    """A load 20 kg heavier than the rig file says, as references know to half a kilogram."""
    known = Nuisance(MASS, 0.5, "kg", mean=20.0)
    return locate(record(effect("payload_mass", "platform", mass=20.0)), AXIS, nuisances=[known])


def test_what_references_hold_closely_and_far_from_the_rig_file_stays_there(heavier: Located):
    (mass,) = heavier.nuisances
    at = heavier.evidence.problem.table.index(MASS)
    assert mass.change == pytest.approx(20.0, abs=0.5)
    assert heavier.evidence.vector[at] == pytest.approx(mass.change)
    assert not heavier.is_gap


def test_a_start_out_of_bounds_is_brought_into_them(heavier: Located):
    problem = heavier.evidence.problem
    noise = find_noise(problem, problem.base, np.random.default_rng(3), count=2)
    at = problem.table.index(MASS)
    start = problem.base.copy()
    start[at] = -40.0
    best = refit(problem, noise, [Nuisance(MASS, 1.0, "kg", mean=20.0)], start)
    assert best.vector[at] == pytest.approx(best.fitted[0].change)
    assert best.fitted[0].change == pytest.approx(20.0, abs=2.0)
