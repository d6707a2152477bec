"""Which weighed fits are findings: what unseen data bear out, and sets that a simpler one does as well."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

import hil.gap.judged.clear as module
from hil.gap.fits.evidence import Weighed
from hil.gap.judged import causes
from hil.gap.judged.clear import clear
from hil.gap.judged.diagnosis import ParameterValue


def weighed(nats: float, *names: str, prior: float = 0.0) -> Weighed:
    """A fit of effects by name, with what it moves told by `traces`."""
    leaves = tuple(SimpleNamespace(effect=n, location="axis", name=f"axis.{n}") for n in names)
    f = SimpleNamespace(
        leaves=leaves, prior_cost=prior, names=(), values=np.zeros(0), z=np.zeros(0)
    )
    return Weighed(f, nats, 0.5)


@pytest.fixture
def found(monkeypatch):
    """What is clear of some, each a trace of so many floors; `seen` on unseen data, (before, shrink)."""

    def ask(some, trace, seen=(1.0, None), is_large=False, further=True, share=0.5):
        monkeypatch.setattr(module, "traces", lambda c, none, f: {"axis.force": trace})
        monkeypatch.setattr(module, "explained", lambda *a, **k: share)
        monkeypatch.setattr(module, "goes_further", lambda *a, **k: further)
        c = SimpleNamespace(problem=SimpleNamespace(discount=20.0), nuisances=())
        none = SimpleNamespace(leaves=(), prior_cost=0.0, z=np.zeros(0))
        before, shrink = seen
        part = SimpleNamespace(before=before, floor=1.0, shrink=shrink)
        kept = clear(c, none, some, 0.0, is_large, lambda f: part)
        return [tuple(x.effect for x in w.fit.leaves) for w in kept]

    return ask


def test_a_mass_that_unseen_data_bear_out_is_found_and_else_not(found):
    heavy = [weighed(8.0, "payload_mass")]
    assert found(heavy, 0.7, seen=(2.5, 0.95)) == [("payload_mass",)]
    assert found(heavy, 0.7, seen=(2.5, 0.3)) == []
    assert found(heavy, 0.7, seen=(1.2, 0.95)) == []
    assert found([weighed(3.0, "payload_mass")], 0.7, seen=(2.5, 0.95)) == []


def test_what_nuisances_swallowed_all_but_a_trace_is_found_by_its_evidence(found):
    turned = [weighed(25.0, "sensor_misalignment")]
    assert found(turned, 0.2) == [("sensor_misalignment",)]
    assert found([weighed(15.0, "sensor_misalignment")], 0.2) == []


def test_what_always_acts_may_be_small_where_it_explains_nearly_all(found):
    soft = [weighed(35.0, "compliance")]
    assert found(soft, 0.65, share=0.92) == [("compliance",)]
    assert found(soft, 0.65, share=0.7) == []
    assert found(soft, 0.55, share=0.92) == []
    assert found([weighed(95.0, "compliance")], 0.65, share=0.7) == [("compliance",)]
    assert found([weighed(28.0, "compliance")], 0.65, share=0.92) == []


def test_a_set_must_be_clear_beside_what_is_simpler_and_as_good(found):
    some = [weighed(160.0, "loop_gain", "sensor_scale"), weighed(145.0, "force_constant"),
            weighed(118.0, "loop_gain")]  # fmt: skip
    assert ("loop_gain", "sensor_scale") not in found(some, 0.9, is_large=True)
    assert ("loop_gain", "sensor_scale") in found(some, 1.4, is_large=True)


def test_a_set_must_go_further_than_one_effect_that_is_none_of_its_own(found):
    """A scale of an accelerometer explains what a lead error and a force constant do, but for small ways."""
    some = [weighed(410.0, "lead_error", "force_constant"), weighed(395.0, "sensor_scale"),
            weighed(190.0, "lead_error")]  # fmt: skip
    assert ("lead_error", "force_constant") in found(some, 1.4, is_large=True)
    alone = found(some, 1.4, is_large=True, further=False)
    assert alone[0] == ("sensor_scale",)
    assert ("lead_error", "force_constant") not in alone


def test_a_nuisance_that_stands_further_needs_little_evidence_unless_it_always_acts(
    found, monkeypatch
):
    """Six legs on a busy bus: a healthy one's delay had 7 nats and stood 1.4 ms off."""
    monkeypatch.setattr(module, "is_further", lambda *a: True)
    assert found([weighed(6.0, "coulomb_friction")], 0.1) == [("coulomb_friction",)]
    assert found([weighed(4.0, "coulomb_friction")], 0.1) == []
    assert found([weighed(7.1, "transport_delay")], 0.1) == []
    assert found([weighed(33.0, "transport_delay")], 0.1) == [("transport_delay",)]


def test_what_strains_nuisances_as_no_healthy_rig_does_pays_for_a_further_effect(found):
    """A tilted rig beside a friction that is found: three nuisances stood at their bounds."""

    def asked(strain: float):
        rubs = weighed(100.0, "coulomb_friction", prior=strain)
        return found([weighed(103.0, "coulomb_friction", "base_tilt"), rubs], 1.4, is_large=True)

    assert asked(17.0)[0] == ("coulomb_friction", "base_tilt")
    assert asked(12.0) == [("coulomb_friction",)]


def test_what_answers_as_a_finding_does_is_one_as_well(found, monkeypatch):
    some = [weighed(52.0, "sensor_bias"), weighed(51.0, "sensor_scale")]
    monkeypatch.setattr(module, "distance", lambda c, a, b: 1.0)
    assert found(some, 0.9) == [("sensor_bias",)], "a scale always acts and must show more"
    monkeypatch.setattr(module, "distance", lambda c, a, b: 0.05)
    assert found(some, 0.9) == [("sensor_bias",), ("sensor_scale",)]


@pytest.fixture
def doubtful(monkeypatch):
    """What is left of weighed fits, of which a delay and lost frames may as well be none."""
    reach = {
        "coulomb_friction": (20.0, 40.0),
        "transport_delay": (-2e-4, 1e-3),
        "lost_frames": (0.0, 0.01),
    }

    def intervals(c, f, leaf, worth):
        return {"value": ParameterValue(0.0, reach[leaf.effect], "1", False)}

    monkeypatch.setattr(causes, "_parameters", intervals)
    table = {f"axis.{n}.value": SimpleNamespace(neutral=0.0) for n in reach}
    c = SimpleNamespace(problem=SimpleNamespace(table=table))

    def left(some, is_large=False):
        return causes.without_doubtful(c, some, 1.0, is_large)

    return left


def test_what_may_as_well_be_nothing_is_not_named_beside_others(doubtful):
    late, lost, rubs = (
        weighed(300.0, "coulomb_friction", "transport_delay"),
        weighed(290.0, "coulomb_friction", "lost_frames"),
        weighed(200.0, "coulomb_friction"),
    )
    left = doubtful([late, lost, rubs])
    assert [w.fit for w in left] == [lost.fit, rubs.fit]
    assert sum(w.probability for w in left) == pytest.approx(1.0)
    assert doubtful([late])[0].fit is late.fit


def test_a_small_gap_of_what_may_as_well_be_nothing_is_none(doubtful):
    late, rubs = weighed(7.0, "transport_delay"), weighed(6.0, "coulomb_friction")
    assert doubtful([late, rubs]) == []
    assert [w.fit for w in doubtful([late, rubs], is_large=True)] == [late.fit, rubs.fit]
    assert [w.fit for w in doubtful([rubs, late])] == [rubs.fit, late.fit]
