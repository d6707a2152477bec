"""Sets: what is as good in an effect's place beside the others is tried, and no set is there twice."""

import numpy as np
import pytest

from hil.configfile import load_rig
from hil.gap.catalogue.nuisances import default_nuisances
from hil.gap.fits.fit import fit
from hil.gap.fits.heldout import split
from hil.gap.fits.starts import changes_of
from hil.gap.fits.training import begin, candidates_of
from hil.gap.located.locate import locate
from hil.gap.search.candidates import _bettered
from hil.gap.search.joint import _as_good
from hil.gap.search.linear import Search
from tests.gap.twin_runs import effect, record

AXIS = load_rig("axis")
UPRIGHT = AXIS.model_copy(
    update={"geometry": AXIS.geometry.model_copy(update={"load": "vertical"})}
)
"""Gravity acts along it: a payload looks like a drive that pushes harder, or a force that reads too high."""


@pytest.fixture(scope="module")
def searched():
    """A vertical axis with a payload and friction; its search, leaves by name, and how a set is fitted."""
    frame = record(
        effect("coulomb_friction", force=60.0),
        effect("payload_mass", "platform", mass=12.0),
        rig=UPRIGHT,
        duration_s=8.0,
    )
    e = locate(frame, UPRIGHT).evidence
    parts = split(e.problem, e.noise, e.residual)
    c, none = begin(e, parts, default_nuisances(UPRIGHT, e.problem.signals), {}, 0)
    bank = candidates_of(c, none, ())
    search = Search(c, bank)
    leaves = {x.name: x for x in bank.leaves}

    def fitted(*names: str):
        some = [leaves[n] for n in names]
        p = search.set_of(tuple(bank.leaves.index(x) for x in some))
        return fit(c, some, search.felt(changes_of(some, p.starts, c.problem), p), p.z)

    return c, none, search, fitted


def test_a_search_beside_a_fit_is_a_search_of_what_that_leaves(searched):
    _, none, search, fitted = searched
    rubbing = fitted("axis.coulomb_friction")
    gains = {search.bank.leaves[p.leaves[0]].name: p.gain for p in search.beside(rubbing).alone()}
    assert max(gains, key=lambda name: gains[name]) != "axis.coulomb_friction"
    assert gains["platform.payload_mass"] > 0.8 * gains["axis.force_constant"] > 100.0
    again = search.beside(none).alone()
    assert [p.gain for p in again] == pytest.approx([p.gain for p in search.alone()])


def test_what_the_linear_picture_cannot_tell_from_an_effect_is_tried_in_its_place(searched):
    c, _, search, fitted = searched
    rubbing = fitted("axis.coulomb_friction")
    stronger = fitted("axis.coulomb_friction", "axis.force_constant")
    said: list[str] = []
    found = _as_good(c, [rubbing, stronger], [stronger], search, search.bank.leaves, said.append)
    sets = [{leaf.name for leaf in f.leaves} for f in found]
    assert {"axis.coulomb_friction", "platform.payload_mass"} in sets
    assert all("axis.coulomb_friction" in s and len(s) == 2 for s in sets)
    assert {"axis.coulomb_friction", "axis.force_constant"} not in sets  # it is there already
    laden = next(f for f in found if any(x.name == "platform.payload_mass" for x in f.leaves))
    mass = dict(zip(laden.names, laden.values, strict=True))["platform.payload_mass.mass"]
    assert mass == pytest.approx(12.0, rel=0.1)
    assert laden.total(c) < stronger.total(c) + 1.0


def test_a_set_in_another_order_is_the_same_set(searched):
    c, _, _, fitted = searched
    one = fitted("axis.coulomb_friction", "axis.force_constant")
    other = fitted("axis.force_constant", "axis.coulomb_friction")
    assert one.is_of(other.leaves)
    kept = _bettered(c, [one], [other])
    assert len(kept) == 1
    assert kept[0].total(c) == min(one.total(c), other.total(c))
    assert np.isfinite(kept[0].total(c))
