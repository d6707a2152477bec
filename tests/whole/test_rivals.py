"""Which of two that answer alike is nearer is told where their fits end; and what acts in moments is kept."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

import hil.gap.fits.evidence as evidence
import hil.gap.search.joint as joint
from hil.gap import diagnose
from hil.gap.catalogue.leaves import find_leaves
from hil.gap.catalogue.nuisances import default_nuisances
from hil.gap.fits.fit import fit
from hil.gap.fits.heldout import split
from hil.gap.fits.training import begin
from hil.gap.judged.verdict import _is_once
from hil.gap.located.locate import locate
from hil.gap.record.leaf import Leaf
from hil.gap.search.replayed import suspects
from hil.gap.search.rivals import ended
from tests.gap.twin_runs import AXIS, effect, record


@pytest.fixture(scope="module")
def heavy():
    """A load that is too heavy: what was calibrated, and the candidates by name."""
    e = locate(record(effect("payload_mass", "platform", mass=40.0)), AXIS).evidence
    parts = split(e.problem, e.noise, e.residual)
    c, none = begin(e, parts, default_nuisances(AXIS, e.problem.signals), {}, 0)
    leaves = find_leaves(c.problem, none.vector, none.residual, ())
    return c, none, {leaf.name: leaf for leaf in leaves}


def test_rivals_that_were_left_on_the_way_end_where_they_answer_alike(heavy):
    c, none, leaves = heavy
    load = fit(c, [leaves["platform.payload_mass"]], {"platform.payload_mass.mass": 40.0})
    rotor = fit(
        c, [leaves["axis.actuator_inertia"]], {"axis.actuator_inertia.mass": 25.0}, rounds=1
    )
    assert load is not None
    assert rotor is not None
    best, other = ended(c, none, [load, rotor], lambda _: None)
    assert best.total(c) <= load.total(c)
    assert other.total(c) <= rotor.total(c)
    assert other.total(c) == pytest.approx(best.total(c), abs=2.0 * c.problem.discount)


def test_a_fit_without_rivals_is_left_as_it_is(heavy):
    c, none, leaves = heavy
    load = fit(c, [leaves["platform.payload_mass"]], {"platform.payload_mass.mass": 40.0})
    rub = fit(c, [leaves["axis.coulomb_friction"]], {"axis.coulomb_friction.force": 2.0})
    assert ended(c, none, [load, rub], lambda _: None) == [load, rub]
    assert ended(c, none, [load], lambda _: None) == [load]


def test_a_limit_that_only_the_seen_run_hits_is_named():
    limit = effect("velocity_saturation", limit=0.115)
    found = diagnose([record(limit), record(limit, share=0.5, seed=2)], AXIS)
    assert [x.effect for x in found.effects] == ["velocity_saturation"]


def test_only_what_acts_now_and_then_beyond_doubt_may_be_missing_from_unseen_data():
    c = SimpleNamespace(problem=SimpleNamespace(discount=20.0))

    def once(name: str, nats: float) -> bool:
        return _is_once(c, SimpleNamespace(leaves=[SimpleNamespace(effect=name)]), nats)

    assert once("velocity_saturation", 600.0)
    assert not once("velocity_saturation", 20.0)
    assert not once("viscous_friction", 600.0)


def test_a_law_with_freedom_that_nothing_asks_for_is_behind_however_large_the_gap():
    found = diagnose(record(effect("coulomb_friction", force=150.0)), AXIS)
    assert [x.effect for x in found.effects] == ["coulomb_friction"]
    others = [x.probability for x in found.causes if x.effect.endswith("_friction")]
    assert max(others[1:], default=0.0) < 0.1


def asked(
    sizes: dict[str, float], floors: dict[str, float], promise: dict[str, float]
) -> list[str]:
    """The springs that are asked where signals of `sizes` have `floors`, by actuator."""
    springs = [
        Leaf("compliance", a, (f"{a}.compliance.stiffness",), (), a)
        for a in (s.partition(".")[0] for s in sizes)
        if a != "imu"
    ]
    series = [SimpleNamespace(signal=s, actuator=s.partition(".")[0]) for s in sizes]

    def rms(_, some: str) -> dict[str, float]:
        return floors if some == "draws" else sizes

    noise = SimpleNamespace(draws="draws", rms=rms, weighted_rms=rms)
    c = SimpleNamespace(problem=SimpleNamespace(series=series), noise=noise)
    left = SimpleNamespace(residual="residual")
    return [x.location for x in suspects(c, left, springs, promise=promise)]


def test_a_spring_that_an_imu_alone_feels_is_asked():
    sizes = {"axis.force": 1.1, "imu.accel_x": 3.0}
    assert asked(sizes, dict.fromkeys(sizes, 1.0), {}) == ["axis"]
    assert asked(sizes, {"axis.force": 1.0, "imu.accel_x": 2.0}, {}) == []


def test_springs_that_shake_an_imu_go_by_what_they_promise_and_others_by_what_their_drives_leave():
    promise = {f"leg{k}.compliance": float(k) for k in range(1, 5)}
    for shaken, order in ((9.0, ["leg4", "leg3", "leg2"]), (3.0, ["leg1", "leg2"])):
        sizes = {f"leg{k}.force": 5.0 - k for k in range(1, 5)} | {"imu.gyro_z": shaken}
        assert asked(sizes, dict.fromkeys(sizes, 1.0), promise) == order


@pytest.mark.parametrize(("prior", "expected"), [(2.0, True), (15.0, False)])
def test_a_fit_that_pushed_nuisances_far_is_not_whole(monkeypatch, prior, expected):
    monkeypatch.setattr(joint, "most_left", lambda c, f: 1.0)
    head = SimpleNamespace(prior_cost=prior, residual=np.zeros(3))
    assert joint.is_whole(SimpleNamespace(), head, joint.LEFT) is expected


def test_freedom_that_a_gap_asks_for_costs_no_more_than_that_of_the_law_that_leaves_it(monkeypatch):
    def law(name, parameters, ratio):
        leaf = Leaf(name, "axis", (), (), "axis")
        return SimpleNamespace(leaves=(leaf,), names=("x",) * parameters, ratio=ratio)

    monkeypatch.setattr(evidence, "largest_ratio", lambda c, f: f.ratio)
    none = SimpleNamespace(leaves=(), names=(), ratio=9.0)
    viscous, peaked = law("viscous_friction", 1, 5.0), law("stribeck_friction", 3, 1.2)
    leaves_a_gap, leaves_none = (law("coulomb_friction", 1, ratio) for ratio in (1.8, 1.0))
    assert evidence._asked_for(None, [none, viscous, leaves_a_gap, peaked]) == [(3, [1, 2])]
    assert evidence._asked_for(None, [none, viscous, leaves_none, peaked]) == []
    assert evidence._asked_for(None, [none, viscous, leaves_a_gap, law("hysteresis", 2, 1.6)]) == []
