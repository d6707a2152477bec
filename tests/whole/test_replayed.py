"""What no linear picture shows is found by replays; frames that all drives lack were never sent."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from hil.gap import diagnose
from hil.gap.catalogue.nuisances import default_nuisances
from hil.gap.fits.heldout import split
from hil.gap.fits.training import begin, candidates_of
from hil.gap.located.locate import locate
from hil.gap.search.replayed import least_left, struck, suspects
from tests.gap.twin_runs import AXIS, effect, record


def begun(frame):
    """A record calibrated, the twin without effects, and the candidates."""
    e = locate(frame, AXIS).evidence
    parts = split(e.problem, e.noise, e.residual)
    c, none = begin(e, parts, default_nuisances(AXIS, e.problem.signals), {}, 0)
    return c, none, candidates_of(c, none, ()).leaves


def scanned(frame, name: str) -> dict[str, float]:
    """What the scan finds for the candidate `name`, if it is asked."""
    c, none, leaves = begun(frame)
    asked = suspects(c, none, leaves)
    found = [least_left(c, none, leaf) for leaf in asked if leaf.name == name]
    return found[0] if found else {}


def test_a_wide_gap_is_found_by_replaying_each_width():
    found = scanned(record(effect("backlash", gap=9e-4)), "axis.backlash")
    assert found["axis.backlash.gap"] == pytest.approx(9e-4, rel=0.3)


def test_a_gap_of_a_worn_out_joint_is_found_too():
    found = scanned(record(effect("backlash", gap=0.014)), "axis.backlash")
    assert found["axis.backlash.gap"] == pytest.approx(0.014, rel=0.3)


def test_an_actuator_that_is_held_off_for_a_moment_is_asked_for_limits_and_gaps():
    frame = record()
    answered = frame.index[frame["axis.position"].notna()]
    hit = {"backlash", "force_saturation", "velocity_saturation"}
    for off_m, asked in ((0.0, set()), (4e-4, hit)):
        held = frame.copy()
        held.loc[answered[300:308], "axis.position"] -= off_m
        c, none, leaves = begun(held)
        assert {x.effect for x in suspects(c, none, leaves, struck(c, none))} & hit == asked


def test_a_speed_limit_that_is_seldom_hit_is_found_by_replays():
    found = diagnose(record(effect("velocity_saturation", limit=0.115)), AXIS)
    assert [x.effect for x in found.effects] == ["velocity_saturation"]
    assert found.effects[0].parameters["limit"].value == pytest.approx(0.115, rel=0.02)


def test_nobody_is_suspected_on_a_healthy_record():
    c, none, leaves = begun(record())
    assert suspects(c, none, leaves) == []


def test_knocks_that_weights_cut_as_spikes_are_asked_for_gaps():
    c, none, leaves = begun(record())
    (part,) = (x.part for x in c.problem.series if x.signal == "axis.force")
    knocked = np.array(none.residual)
    knocked[part][::40] += 15.0 * c.noise.sigma[part][::40]
    asked = {x.effect for x in suspects(c, replace(none, residual=knocked), leaves)}
    assert "backlash" in asked
