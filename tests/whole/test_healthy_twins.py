"""What a twin of another healthy rig explains is no finding; what none does is one (decision 8)."""

import math
from dataclasses import replace

import pytest

from hil.config import LegMass
from hil.configfile import load_rig
from hil.exam.world import Scatter, build_world, play
from hil.gap.diagnose import diagnose
from hil.gap.located.habit import is_finer, share_of
from hil.gap.located.habits import (
    BENDS,
    BENDS_M,
    FEEDS,
    GUIDES,
    LATER_S,
    LEADS,
    LEGS,
    LOADS,
    RESTS,
    TAKES_TIME,
    WEIGHS,
)
from hil.gap.located.locate import locate
from hil.gap.record.runs import as_runs
from hil.gap.rounds.twins import shown
from tests.exam.worlds import sway
from tests.gap.test_habits import SWINGING
from tests.gap.twin_runs import AXIS, effect, record

QUIET = AXIS.model_copy(
    update={"noise": AXIS.noise.model_copy(update={"force": 1.0, "force_step": 0.5})}
)
"""A drive whose current is quiet enough to show what a screw gives."""
COULOMB = effect("coulomb_friction", force=40.0)


def resting(*effects, seed=1):
    """A record of drives that rest for a tick, their force asked for where it no longer swings."""
    return record(*effects, rig=RESTS.twin(AXIS, 1.0), seed=seed, asked_s=0.004)


def leading(*effects, seed=1):
    """A record of drives that make the first step to each setpoint as they take it."""
    return record(*effects, rig=LEADS.twin(AXIS, 1.0), seed=seed)


def spring(stiffness):
    damping = 0.1 * math.sqrt(stiffness * AXIS.mass.m)
    return effect("compliance", stiffness=stiffness, damping=damping)


def with_coulomb(force):
    """The bench's rig file with so much Coulomb friction."""
    (axis,) = AXIS.actuators
    return AXIS.model_copy(update={"actuators": (axis.model_copy(update={"coulomb": force}),)})


def feeding(*effects):
    """A pendulum's record, of drives that feed its static force forward though its rig file has them not."""
    (run,) = as_runs(record(*effects, rig=FEEDS.twin(SWINGING, 1.0), share=1.5), SWINGING)
    return replace(run, rig=SWINGING)


def hexapod(leg):
    """A record of the force-controlled hexapod in a world whose legs are `leg`, by a rig file without."""
    rig = load_rig("stewart_pd")
    legs = tuple(a.model_copy(update={"leg": leg}) for a in rig.actuators)
    world = build_world(rig.model_copy(update={"actuators": legs}), Scatter(3))
    played = play(world, sway(rig, 12.0, share=0.5), seen=1, hidden=2, with_imu=False)
    (run,) = as_runs(played.table(world), rig)
    return replace(run, rig=rig)


def is_told(answer, habit=RESTS):
    return any(f.subject == habit.key for f in answer.located.findings)


def named(answer):
    return [(x.effect, x.location) for x in answer.effects]


def test_a_healthy_rig_whose_drives_rest_has_no_gap_and_the_reader_is_told():
    (run,) = as_runs(resting(), AXIS)
    answer = diagnose(replace(run, rig=AXIS), AXIS)
    assert answer.verdict == "no_gap"
    assert is_told(answer)
    assert not any("kept with the run" in f.text for f in answer.located.findings)


def test_an_effect_is_named_beside_the_rest():
    answer = diagnose(resting(COULOMB), AXIS)
    assert is_told(answer)
    assert named(answer) == [("coulomb_friction", "axis")]


def test_a_rest_of_the_references_is_one_of_the_run():
    answer = diagnose(resting(COULOMB, seed=2), AXIS, references=resting())
    assert is_told(answer)
    assert answer.located.evidence.problem.rig.bus.interpolation == "linear_rests"
    assert named(answer) == [("coulomb_friction", "axis")]


@pytest.mark.parametrize("rests", [True, False])
def test_drives_that_rest_show_in_the_fine_structure_of_force(rests):
    """Where setpoints jitter their kicks fall nowhere on those of a twin that does not, gap or none."""
    rig = RESTS.twin(AXIS, 1.0) if rests else AXIS
    drag = effect("viscous_friction", coefficient=300.0)
    run = record(drag, rig=rig, jitter_s=9e-4)
    without = locate(run, AXIS)
    _, habits = shown(lambda twin: locate(run, twin), without, [RESTS])
    assert [h for h, _ in habits] == ([RESTS] if rests else [])
    assert is_finer(locate(run, RESTS.twin(AXIS, 1.0)), without) is rests


@pytest.mark.parametrize("rests", [True, False])
def test_a_drag_beyond_calibration_is_no_drive_that_rests_nor_hides_one(rests):
    """Force that is read in step with setpoints: what a large drag leaves of it is finer beside either."""
    rig = RESTS.twin(AXIS, 1.0) if rests else AXIS
    drag = effect("viscous_friction", coefficient=600.0)
    run = record(drag, effect("transport_delay", delay=0.002), rig=rig)
    _, habits = shown(lambda twin: locate(run, twin), locate(run, AXIS), [RESTS])
    assert [h for h, _ in habits] == ([RESTS] if rests else [])


def test_drives_that_are_a_tick_early_are_seen_and_what_is_beside_it_is_named():
    answer = diagnose(leading(COULOMB), AXIS)
    assert answer.located.evidence.problem.rig.bus.interpolation == "linear_leads"
    assert is_told(answer, LEADS)
    assert named(answer) == [("coulomb_friction", "axis")]


def test_drives_whose_references_are_a_tick_early_hide_no_delay():
    """A single drive that is late besides looks half as late without them."""
    late = leading(effect("transport_delay", delay=0.002), seed=2)
    answer = diagnose(late, AXIS, references=leading())
    assert is_told(answer, LEADS)
    assert named(answer) == [("transport_delay", "axis")]
    assert answer.effects[0].parameters["delay"].value == pytest.approx(0.002, abs=4e-4)


def test_drives_that_are_in_time_are_not_called_early():
    assert share_of(LEADS, locate(record(), AXIS)) == 0.0
    assert not is_told(diagnose(record(), AXIS, references=record(seed=2)), LEADS)


def test_viscous_friction_is_not_taken_for_drives_that_rest():
    answer = diagnose(record(effect("viscous_friction", coefficient=900.0)), AXIS)
    assert not is_told(answer)
    assert named(answer) == [("viscous_friction", "axis")]


def test_static_force_fed_forward_is_no_gap_and_the_reader_is_told():
    answer = diagnose(feeding(), SWINGING)
    assert answer.verdict == "no_gap"
    assert is_told(answer, FEEDS)


def test_an_effect_is_named_beside_static_force_fed_forward():
    answer = diagnose(feeding(COULOMB), SWINGING)
    assert is_told(answer, FEEDS)
    assert named(answer) == [("coulomb_friction", "axis")]


@pytest.fixture(scope="module")
def massless():
    run = hexapod(LegMass())
    return locate([run], run.rig)


@pytest.mark.parametrize(("habit", "is_fed"), [(WEIGHS, True), (LOADS, False)])
def test_legs_that_weigh_something_are_seen_and_legs_that_do_not_are_not(massless, habit, is_fed):
    heavy = LegMass(
        lower_mass=2.0, lower_cog=0.35, lower_inertia=0.05,
        upper_mass=1.5, upper_cog=0.3, upper_inertia=0.03, is_fed=is_fed,
    )  # fmt: skip
    run = hexapod(heavy)
    share = share_of(habit, locate([run], run.rig))
    assert share_of(habit, massless) == 0.0
    kg = 0.5 * LEGS * run.rig.mass.m * share / 6.0
    assert 0.4 < kg < 2.5  # of each half


def test_a_screw_of_forty_newtons_a_micrometre_is_healthy():
    run = record(spring(4e7), rig=QUIET, share=1.8, duration_s=10.0, jitter_s=9e-4)
    answer = diagnose(run, QUIET)
    assert answer.verdict == "no_gap"
    (told,) = (f for f in answer.located.findings if f.subject in ("transmissions", "twin"))
    assert "transmissions" in told.text or "compliance" in told.text


def test_a_screw_of_three_newtons_a_micrometre_is_not():
    answer = diagnose(record(spring(3e6), rig=QUIET), QUIET)
    assert named(answer) == [("compliance", "axis")]
    assert 2.5e6 < answer.effects[0].parameters["stiffness"].value < 3.5e6


def test_a_soft_transmission_is_named_though_its_load_rubs():
    """A load that stops swinging at once is unlike that of a twin of which the motor alone rubs."""
    rig = with_coulomb(90.0)
    soft = effect("compliance", stiffness=1.4e5, damping=250.0)
    answer = diagnose(record(soft, rig=GUIDES.twin(rig, 0.5), duration_s=10.0), rig)
    assert named(answer) == [("compliance", "axis")]
    assert answer.effects[0].parameters["stiffness"].value == pytest.approx(1.4e5, rel=0.05)
    (finding,) = [f for f in answer.located.findings if f.subject == "actuators.guide_share"]
    assert finding.belongs == [pytest.approx(0.5, abs=0.25)]


def test_friction_that_builds_up_within_micrometres_is_no_gap_and_is_said():
    fast = load_rig("axis_canopen")
    found = diagnose(record(rig=BENDS.twin(fast, 1.0), duration_s=10.0), fast)
    assert found.verdict == "no_gap"
    (finding,) = [f for f in found.located.findings if f.subject == "actuators.presliding"]
    assert finding.belongs == [pytest.approx(BENDS_M, rel=0.5)]


@pytest.mark.parametrize(
    ("what", "verdict"),
    [((), "no_gap"), ((effect("transport_delay", delay=0.0012),), "identified")],
    ids=["healthy", "late"],
)
def test_loops_that_take_their_time_are_no_gap_and_hide_none(what, verdict):
    fast = load_rig("axis_canopen")
    found = diagnose(record(*what, rig=TAKES_TIME.twin(fast, 3.0), duration_s=10.0), fast)
    assert found.verdict == verdict
    assert [x.effect for x in found.effects] == [x.effect for x in what]
    (finding,) = [f for f in found.located.findings if f.subject == "actuators.current_hz"]
    (lag_s,) = (1.0 / (2.0 * math.pi * hz) for hz in finding.belongs)
    own_s = 1.0 / (2.0 * math.pi * fast.actuators[0].current_hz)
    assert lag_s - own_s == pytest.approx(3.0 * LATER_S, rel=0.6)


FINE = load_rig("axis_canopen")
"""An axis whose encoder shows micrometres."""
USUAL = (
    effect("lead_error", amplitude=1.5e-6, period=0.005, phase=0.5),
    effect("loop_gain", position=0.98, speed=1.03, integral=1.0),
)
"""What its screw and the filters of its drive do, as those of any."""


def test_a_screw_that_wobbles_and_a_drive_with_filters_are_no_gap():
    answer = diagnose(record(*USUAL, rig=FINE, duration_s=12.0), FINE)
    assert answer.verdict == "no_gap"
    (told,) = (f for f in answer.located.findings if f.subject == "twin")
    assert "no larger than any healthy rig's" in told.text


def test_beside_them_a_cause_is_named_alone():
    rubbing = effect("coulomb_friction", force=12.0)
    answer = diagnose(record(*USUAL, rubbing, rig=FINE, duration_s=12.0), FINE)
    assert answer.verdict == "identified"
    assert [x.effect for x in answer.effects] == ["coulomb_friction"]
    assert answer.causes[0].parameters["force"].value == pytest.approx(12.0, rel=0.15)
    (told,) = (f for f in answer.located.findings if f.subject == "twin")
    assert "lead error (period 0.005 m, amplitude 1.5" in told.text
