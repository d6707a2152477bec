"""Effects that act together: steps and lost frames beside others, two laws of friction, a peak at rest."""

import numpy as np
import pytest

from hil.gap import diagnose
from hil.gap.fits.friction import may_join
from hil.gap.record.leaf import Leaf
from hil.sim import Twin
from tests.gap.twin_runs import AXIS, effect, record


def named(found):
    return {(x.effect, x.location) for x in found.effects}


def value(found, effect_name, parameter):
    cause = next(x for x in found.effects if x.effect == effect_name)
    return cause.parameters[parameter]


def in_steps(run, signal, step):
    out = run.copy()
    out[signal] = step * np.round(out[signal] / step)
    return out


@pytest.fixture(scope="module")
def rubbing():
    return record(effect("viscous_friction", coefficient=400.0))


def test_steps_of_a_signal_do_not_hide_the_friction_beside_them(rubbing):
    found = diagnose(in_steps(rubbing, "axis.position", 4e-4), AXIS)
    assert named(found) == {("viscous_friction", "axis"), ("sensor_quantisation", "axis.position")}
    assert value(found, "sensor_quantisation", "step").value == pytest.approx(4e-4, rel=1e-3)
    assert value(found, "viscous_friction", "coefficient").value == pytest.approx(400.0, rel=0.1)


def test_steps_alone_are_nothing_else():
    found = diagnose(in_steps(record(), "axis.position", 4e-4), AXIS)
    assert found.verdict == "identified"
    assert named(found) == {("sensor_quantisation", "axis.position")}


def test_two_laws_of_friction_are_told_apart_at_one_place():
    both = record(
        effect("viscous_friction", coefficient=500.0), effect("coulomb_friction", force=50.0)
    )
    found = diagnose(both, AXIS)
    assert named(found) == {("viscous_friction", "axis"), ("coulomb_friction", "axis")}
    assert value(found, "coulomb_friction", "force").value == pytest.approx(50.0, rel=0.15)
    groups = [x.group for x in found.effects]
    assert len(set(groups)) == 2, "what acts together is told apart"


def test_a_peak_at_rest_is_found_where_no_linear_picture_shows_it():
    peak = effect("stribeck_friction", coulomb=50.0, static=200.0, velocity=0.009)
    found = diagnose(record(peak, share=0.08), AXIS)
    assert found.effects[0].effect == "stribeck_friction"
    assert value(found, "stribeck_friction", "static").value == pytest.approx(200.0, rel=0.25)


def test_frames_lost_beside_a_friction_are_named_as_well():
    found = diagnose(with_lost_frames(effect("coulomb_friction", force=60.0)), AXIS)
    assert named(found) == {("coulomb_friction", "axis"), ("lost_frames", "bus")}


def test_a_few_lost_frames_are_a_gap_alone():
    found = diagnose(with_lost_frames(every=150), AXIS)
    assert found.verdict == "identified"
    assert named(found) == {("lost_frames", "bus")}


def test_three_frames_that_are_lost_in_fast_motion_are_enough():
    found = diagnose(with_lost_frames(frames=(232, 678, 955)), AXIS)
    assert found.verdict == "identified"
    assert named(found) == {("lost_frames", "bus")}


def test_one_frame_in_eight_that_is_lost_is_counted_where_its_loss_would_show():
    found = diagnose(with_lost_frames(every=8), AXIS)
    assert named(found) == {("lost_frames", "bus")}
    assert value(found, "lost_frames", "setpoints").value == pytest.approx(0.125, rel=0.15)
    assert found.score.shrink > 0.8


def test_frames_lost_in_bursts_are_found_each():
    starts, lengths = (232, 455, 678, 955, 1180), (5, 2, 4, 1, 6)
    frames = [a + k for a, n in zip(starts, lengths, strict=True) for k in range(n)]
    asked = with_lost_frames(frames=frames)
    found = diagnose(asked, AXIS)
    assert found.verdict == "identified"
    assert named(found) == {("lost_frames", "bus")}
    share = len(frames) / asked["axis.setpoint"].notna().sum()
    assert value(found, "lost_frames", "setpoints").value == pytest.approx(share, rel=0.25)
    assert found.score.shrink > 0.9


def with_lost_frames(*effects, every=40, frames=()):
    """A record whose drive never saw one setpoint in `every`, or those numbered `frames`."""
    asked = record(*effects)
    told = asked.dropna(subset=["axis.setpoint"])
    seen = np.ones(len(told), dtype=bool)
    seen[list(frames) or slice(200, 1300, every)] = False
    stamps = {
        s: asked.loc[asked[s].notna(), "t"].to_numpy() for s in ("axis.position", "axis.force")
    }
    setpoints = told["t"].to_numpy()[seen], told["axis.setpoint"].to_numpy()[seen]
    values = Twin(AXIS.model_copy(update={"effects": effects})).replay({"axis": setpoints}, stamps)
    rng = np.random.default_rng(5)
    for s, v in values.items():
        spread = AXIS.noise.position if s.endswith("position") else AXIS.noise.force
        asked.loc[asked[s].notna(), s] = v + spread * rng.standard_normal(len(v))
    return asked


def leaf(effect_name, location="axis"):
    return Leaf(effect_name, location, (), (), location)


def test_forms_of_one_law_never_act_together_and_viscous_friction_beside_any():
    assert not may_join(leaf("coulomb_friction"), [leaf("stribeck_friction")])
    assert not may_join(leaf("hysteresis"), [leaf("asymmetric_friction")])
    assert may_join(leaf("viscous_friction"), [leaf("stribeck_friction")])
    assert may_join(leaf("coulomb_friction"), [leaf("hysteresis")])
    assert may_join(leaf("coulomb_friction", "leg2"), [leaf("stribeck_friction", "leg1")])
    assert not may_join(leaf("viscous_friction"), [leaf("viscous_friction")])


def test_a_force_limit_beside_friction_is_found_where_neither_column_shows_it():
    pair = (effect("coulomb_friction", force=250.0), effect("force_saturation", limit=420.0))
    found = diagnose(record(*pair, duration_s=20.0), AXIS)
    assert "force_saturation" in {x.effect for x in found.effects}


@pytest.mark.parametrize(
    ("law", "parameters"),
    [
        ("coulomb_friction", {"force": 60.0}),
        ("asymmetric_friction", {"positive": 90.0, "negative": 20.0}),
    ],
)
def test_friction_whose_bristles_bend_is_no_hysteresis(law, parameters):
    """Within 0.15 mm, as ball screws' do that are held hard: what a narrow hysteresis looks like."""
    bends = effect("coulomb_friction", presliding=1.5e-4)
    worn = effect(law, **parameters)
    found = diagnose(record(worn, bends), AXIS)
    assert named(found) == {(law, "axis")}
    for name, true in parameters.items():
        assert value(found, law, name).value == pytest.approx(true, abs=8.0)
    if law == "coulomb_friction":
        assert value(found, law, "presliding").value == pytest.approx(1.5e-4, rel=0.3)


@pytest.mark.parametrize("presliding", [4e-5, 1.5e-4])
def test_bristles_of_a_rig_s_own_friction_are_no_effect(presliding):
    found = diagnose(record(effect("coulomb_friction", presliding=presliding)), AXIS)
    assert found.verdict == "no_gap"


def test_what_slips_at_once_is_told_beside_what_gives_way_over_millimetres():
    both = (
        effect("coulomb_friction", force=60.0),
        effect("hysteresis", force=75.0, displacement=2.4e-3),
    )
    found = diagnose(record(*both), AXIS)
    assert named(found) == {("coulomb_friction", "axis"), ("hysteresis", "axis")}
    assert value(found, "coulomb_friction", "force").value == pytest.approx(60.0, rel=0.1)
    assert value(found, "hysteresis", "force").value == pytest.approx(75.0, rel=0.1)
