"""What is a nuisance too, and stands further than calibrations leave any: named though little of it shows."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from hil.gap import diagnose
from hil.gap.catalogue.nuisances import Nuisance
from hil.gap.fits.further import is_further
from hil.gap.judged import doubt
from tests.gap.twin_runs import AXIS, effect, record

RUBS = "axis.coulomb_friction.force"
LATE = "axis.transport_delay.delay"


def asked(name: str, value: float, *, z: float, mean: float = 0.0, sd: float = 1.2) -> bool:
    """Whether a fit of `name` at `value` stands out of a nuisance of it that stood at `z` without."""
    table = SimpleNamespace(index=[RUBS, LATE].index)
    c = SimpleNamespace(
        nuisances=(Nuisance(RUBS, sd, "N", mean),),
        problem=SimpleNamespace(table=table, base=np.zeros(2)),
    )
    leaf = SimpleNamespace(parameters=(name,))
    f = SimpleNamespace(names=(name,), values=np.array([value]))
    return is_further(c, SimpleNamespace(z=np.array([z])), f, [leaf])


def test_a_nuisance_at_its_bound_hides_what_stands_further():
    assert asked(RUBS, 6.0, z=3.0)
    assert not asked(RUBS, 5.0, z=3.0), "a calibration may leave so much"
    assert not asked(RUBS, 6.0, z=2.0), "nothing pulls at the nuisance"
    assert not asked(RUBS, -6.0, z=3.0), "it is pulled the other way"
    assert not asked(LATE, 6.0, z=3.0), "no nuisance of these runs"


def test_it_is_how_far_it_stands_from_where_references_left_it():
    assert asked(RUBS, 10.0, z=3.0, mean=4.0)
    assert not asked(RUBS, 9.0, z=3.0, mean=4.0)


@pytest.mark.parametrize(("ratio", "is_so"), [(1.2, True), (1.8, False)])
def test_of_a_gap_that_shows_no_nuisance_counts_as_explained(monkeypatch, ratio, is_so):
    """The friction nearest to what the catalogue does not know is at its bound as well."""
    table = SimpleNamespace(index=lambda name: 0)
    c = SimpleNamespace(
        nuisances=(Nuisance(RUBS, 1.2, "N"),),
        problem=SimpleNamespace(table=table, base=np.zeros(1), discount=20.0),
    )
    leaf = SimpleNamespace(effect="coulomb_friction", parameters=(RUBS,))
    none = SimpleNamespace(z=np.array([3.0]), prior_cost=4.5)
    f = SimpleNamespace(leaves=(leaf,), names=(RUBS,), values=np.array([9.0]), prior_cost=0.0)
    monkeypatch.setattr(doubt, "largest_ratio", lambda c, f: ratio)
    assert doubt.is_hidden(c, none, f) is is_so


@pytest.mark.parametrize("seed", [1, 2])
def test_friction_that_no_calibration_leaves_is_named_however_little_of_it_is_left(seed):
    """20 N and 7 more: the nuisance takes up 3.6 N, and what is left stands within 1.5 floors."""
    found = diagnose(record(effect("coulomb_friction", force=7.0), seed=seed), AXIS)
    assert [(x.effect, x.location) for x in found.effects] == [("coulomb_friction", "axis")]
    assert found.effects[0].parameters["force"].value == pytest.approx(7.0, rel=0.1)
    assert max(s.ratio for s in found.located.signals) < 1.5


@pytest.mark.parametrize("force", [-3.0, 3.0])
def test_friction_that_calibrations_leave_is_no_gap(force):
    assert diagnose(record(effect("coulomb_friction", force=force)), AXIS).verdict == "no_gap"
