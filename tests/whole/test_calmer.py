"""What hides beside a sure fit, and what neither of two shows alone."""

from dataclasses import replace

import numpy as np
import pytest

from hil.gap import diagnose, locate
from hil.gap.catalogue.leaves import find_leaves
from hil.gap.catalogue.nuisances import default_nuisances
from hil.gap.fits.evidence import weigh
from hil.gap.fits.fit import fit
from hil.gap.fits.friction import nested
from hil.gap.fits.heldout import split
from hil.gap.fits.training import begin
from hil.gap.record.arrivals import find_clocks
from hil.gap.record.leaf import Leaf
from hil.gap.record.problem import Problem
from hil.gap.record.runs import as_runs
from hil.gap.record.ticks import Ticks, acting
from hil.identify.replay import stretches
from tests.gap.twin_runs import AXIS, effect, jittered, record


def leaf(name, location="axis"):
    return Leaf(name, location, (), (), None)


def named(found):
    return {(x.effect, x.location) for x in found.effects}


def test_late_answers_are_found_beside_the_friction_that_made_them_look_like_noise():
    both = record(
        effect("coulomb_friction", force=70.0), effect("sensor_latency", "axis.force", delay=0.012)
    )
    found = diagnose(both, AXIS)
    assert named(found) == {("coulomb_friction", "axis"), ("sensor_latency", "axis.force")}
    late = next(x for x in found.effects if x.effect == "sensor_latency")
    assert late.parameters["delay"].value == pytest.approx(0.012, rel=0.25)


def test_two_that_together_look_like_a_third_are_found():
    both = record(
        effect("viscous_friction", coefficient=420.0),
        effect("payload_mass", "platform", mass=60.0),
    )
    names = named(diagnose(both, AXIS))
    assert ("viscous_friction", "axis") in names
    assert names & {("payload_mass", "platform"), ("actuator_inertia", "axis")}


def test_what_answers_alike_keeps_its_chance():
    found = diagnose(record(effect("actuator_inertia", mass=60.0)), AXIS)
    chance = {x.effect: x.probability for x in found.causes}
    assert min(chance["actuator_inertia"], chance["payload_mass"]) > 0.08


def test_each_place_has_a_share_of_its_effect():
    c, none, leaves = calibrated_axis()
    places = {x.effect: x.places for x in leaves}
    assert places["payload_mass"] == 1
    assert places["sensor_bias"] == 2  # position and force are recorded

    def weighed(some):
        f = fit(c, [some], dict.fromkeys(some.parameters, 0.001))
        ranked, _ = weigh(c, [none, f, replace(f, leaves=(leaf("payload_mass", "platform"),))])
        return {w.fit.leaves[0].effect: w.probability for w in ranked if w.fit.leaves}

    bias = next(x for x in leaves if x.name == "axis.force.sensor_bias")
    chance = weighed(bias)
    assert chance["payload_mass"] / chance["sensor_bias"] == pytest.approx(2.0)


def calibrated_axis():
    """The axis' own record, calibrated, and what could be told from it."""
    located = locate(record(), AXIS)
    e = located.evidence
    chosen = default_nuisances(AXIS, e.problem.signals)
    c, none = begin(e, split(e.problem, e.noise, e.residual), chosen, {}, 0)
    return c, none, find_leaves(c.problem, none.vector, none.residual)


def test_laws_of_friction_at_one_place_hold_one_another_and_others_do_not():
    plain, worn = leaf("coulomb_friction"), leaf("asymmetric_friction")
    heavy = leaf("payload_mass", "platform")
    assert nested([plain], [worn])
    assert nested([plain], [plain, heavy])
    assert not nested([plain], [heavy])
    assert not nested([plain], [leaf("asymmetric_friction", "other")])


def test_frames_near_a_tick_act_where_the_drive_took_them():
    frame = jittered(share=0.5)
    sent = frame.dropna(subset=["axis.setpoint"])["t"].to_numpy()
    (run,) = as_runs(frame, AXIS)
    (clock,) = find_clocks(Problem(AXIS, stretches(run))).values()
    there, true = (acting(AXIS, sent, k) for k in (clock, Ticks(0.0, 0.0, 0.0)))
    other_tick = np.abs(there - true) > 0.5 * AXIS.bus.position_loop
    assert np.mean(other_tick) < 0.01


def test_a_pendulum_may_turn_a_little_heavier_than_its_drawing():
    hanging = AXIS.model_copy(
        update={"geometry": AXIS.geometry.model_copy(update={"load": "pendulum"})}
    )
    names = {n.name for n in default_nuisances(hanging, ["axis.force"])}
    assert "platform.payload_inertia.yy" in names
    assert not any("inertia" in n.name for n in default_nuisances(AXIS, ["axis.force"]))
