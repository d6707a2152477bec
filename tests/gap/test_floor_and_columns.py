"""What a healthy reference says of a run's noise, and which signals show what an effect does."""

import numpy as np
import pandas as pd
import pytest

from hil.configfile import load_rig
from hil.gap.catalogue.bank import fill_bank
from hil.gap.catalogue.leaves import find_leaves
from hil.gap.floor.differences import RARE, times_louder
from hil.gap.floor.draws import FOLLOWED, followed, sensor_sigma
from hil.gap.floor.loudness import BY_SENSORS, HEALTHY, LOUDEST, Level, level_of
from hil.gap.floor.noise import find_noise
from hil.gap.located.locate import locate
from hil.gap.record.problem import Problem
from hil.gap.record.repeats import Repeats
from hil.gap.record.runs import as_runs
from hil.identify.replay import Stretch, stretches
from hil.sim import Twin
from tests.gap.twin_runs import AXIS, effect, record


@pytest.fixture(scope="module")
def noisy():
    """A healthy record's problem, and a residual three times as loud as its rig file says."""
    (run,) = as_runs(record(duration_s=8.0), AXIS)
    problem = Problem(AXIS, stretches(run))
    rng = np.random.default_rng(4)
    residual = rng.standard_normal(problem.size)
    for x in problem.series:
        residual[x.part] *= 3.0 * sensor_sigma(AXIS, x)
    return problem, residual


def told(problem, residual, healthy):
    rng = np.random.default_rng(2)
    return find_noise(
        problem, problem.base, rng, residual=residual, healthy=healthy, count=2
    ).levels


def levels(problem, residual, healthy):
    return {signal: x.sensed for signal, x in told(problem, residual, healthy).items()}


def test_without_a_reference_the_fastest_part_of_a_residual_is_noise(noisy):
    problem, residual = noisy
    assert levels(problem, residual / 2.0, None)["axis.force"] == pytest.approx(1.5, rel=0.1)


def test_repeats_of_a_few_samples_leave_the_noise_to_its_model(noisy):
    problem, residual = noisy
    few = Repeats("a moment", {"axis.position": (np.arange(9), np.arange(20, 29))})
    rng = np.random.default_rng(2)
    found = find_noise(problem, problem.base, rng, repeats=[few], residual=residual, count=2)
    assert "a moment" not in found.text


def test_an_encoder_that_is_far_louder_than_its_file_says_is_a_gap(noisy):
    assert levels(*noisy, None)["axis.position"] == LOUDEST["position"]


def test_a_force_that_is_far_louder_than_its_file_and_timing_make_it_is_a_gap(noisy):
    force = told(*noisy, None)["axis.force"]
    alone, by_timing = BY_SENSORS["force"]
    assert 0.0 < force.lively < 3.0
    assert force.sensed == pytest.approx(alone + by_timing * force.lively)
    assert force.sensed < 2.9


def test_a_run_is_little_louder_than_its_healthy_reference(noisy):
    lively = dict.fromkeys(noisy[0].signals, Level(1.1, 1.1, 100.0))
    assert levels(*noisy, lively)["axis.force"] == pytest.approx(1.1 * HEALTHY)


def test_a_reference_that_hardly_moved_tells_nothing_of_a_lively_run(noisy):
    calm = dict.fromkeys(noisy[0].signals, Level(9.0, 1.1, 0.0))
    assert levels(*noisy, calm) == levels(*noisy, None)


def test_a_homing_error_of_one_leg_shows_in_all_signals_and_its_friction_in_its_own():
    rig = load_rig("motorcycle")
    sent = np.arange(0.0, 5.0, rig.bus.cycle)
    sway = 0.01 * np.sin(2 * np.pi * 0.5 * sent) * np.clip(sent - 0.5, 0.0, 1.0)
    rest = Twin(rig).replay({}, {f"{a}.position": np.array([0.1]) for a in rig.actuator_names})
    told = {a: (sent, rest[f"{a}.position"][0] + sway) for a in rig.actuator_names}
    stamps = {f"{a}.{q}": sent[20:] for a in rig.actuator_names for q in ("position", "force")}
    stamps["imu.accel_y"] = sent[20:]
    answers = Twin(rig).replay(told, stamps)
    piece = Stretch("run", told, {s: (t, answers[s]) for s, t in stamps.items()}, "position")
    problem = Problem(rig, [piece])
    base = problem.predict(problem.base)[0]
    wanted = ("position_offset", "coulomb_friction")
    leaves = [x for x in find_leaves(problem, problem.base, 0.0 * base) if x.effect in wanted]
    bank = fill_bank(problem, problem.base, base, leaves)
    imu = next(x.part for x in problem.series if x.signal == "imu.accel_y")
    moved = {
        leaf.name: float(np.abs(bank.columns[imu, starts[0][0]]).max())
        for leaf, starts in zip(bank.leaves, bank.places, strict=True)
    }
    assert moved["leg2.position_offset"] > 0.005
    assert moved["leg2.coulomb_friction"] == 0.0


def test_what_candidates_do_to_another_twin_is_taken_over_but_for_effects_that_it_has():
    (run,) = as_runs(record(duration_s=6.0), AXIS)
    pieces = stretches(run)
    stiff = Problem(AXIS, pieces)
    leaves = find_leaves(stiff, stiff.base, np.zeros(stiff.size))
    first = fill_bank(stiff, stiff.base, stiff.predict(stiff.base)[0], leaves)
    has = effect("compliance", stiffness=2e7, damping=4e3)
    soft = Problem(AXIS.model_copy(update={"effects": (has,)}), pieces)
    base = soft.predict(soft.base)[0]
    leaves = find_leaves(soft, soft.base, np.zeros(soft.size))
    taken, own = (fill_bank(soft, soft.base, base, leaves, known) for known in (first, None))
    was = {x.name: (x, p) for x, p in zip(first.leaves, first.places, strict=True)}
    count = 0
    for leaf, starts in zip(leaves, taken.places, strict=True):
        mine = [k for cols in starts for k in cols]
        old, place = was[leaf.name]
        is_taken = leaf == old and leaf.effect != "compliance"
        count += is_taken
        source = (
            first.columns[:, [k for cols in place for k in cols]]
            if is_taken
            else own.columns[:, mine]
        )
        np.testing.assert_array_equal(taken.columns[:, mine], source)
    assert count > len(leaves) // 2


def test_frames_that_some_repeats_lost_make_noise_little_louder():
    rng = np.random.default_rng(3)
    modelled, spread = rng.standard_normal((6, 4000)), np.ones(4000)
    measured = 1.2 * rng.standard_normal(4000)
    assert times_louder(measured, modelled, spread) == pytest.approx(1.2, rel=0.05)
    measured[::25] *= 20.0
    assert np.std(measured) > 4.0
    assert 1.2 < times_louder(measured, modelled, spread) < 1.2 * RARE


def test_how_loud_sensors_and_timing_are_is_told_apart():
    rng = np.random.default_rng(6)
    feels = np.where(np.arange(3000) % 10 < 4, 5.0, 0.01)
    late, sensed = feels * rng.standard_normal((6, 3000)), rng.standard_normal((6, 3000))
    left = 1.5 * feels * rng.standard_normal(3000) + 2.0 * rng.standard_normal(3000)
    assert level_of(left, late, sensed, (3.0, 3.0)) == pytest.approx((2.0, 1.5), rel=0.2)
    assert level_of(left, late, sensed, (1.4, 3.0))[0] == 1.4
    assert level_of(0.2 * late[0], late, sensed, (3.0, 3.0))[1] < 0.3


def test_what_differs_wildly_between_repeats_is_no_noise():
    """A motion twice, in both of which the force is struck at random: no sensor or bus makes that."""
    sent = np.arange(0.0, 20.0, AXIS.bus.cycle)
    told = 0.05 * np.sin(2 * np.pi * 0.5 * sent) * np.clip(sent - 0.5, 0.0, 1.0)
    stamps = {f"axis.{q}": sent[20:] + 1.3e-3 for q in ("position", "force")}
    answers = Twin(AXIS).replay({"axis": (sent, told)}, stamps)
    rng = np.random.default_rng(7)
    for signal, spread in (("position", AXIS.noise.position), ("force", AXIS.noise.force)):
        answers[f"axis.{signal}"] += spread * rng.standard_normal(len(sent) - 20)
    struck = rng.random(len(sent) - 20) < 0.3
    answers["axis.force"] += 400.0 * struck * rng.standard_normal(len(struck))
    columns = [pd.DataFrame({"t": sent, "axis.setpoint": told})]
    columns += [pd.DataFrame({"t": stamps["axis.force"], **answers})]
    frame = pd.concat(columns).sort_values("t", kind="stable", ignore_index=True)
    found = locate(frame, AXIS)
    assert "half the difference of their residuals" in found.floor_text
    assert found.is_gap


def test_no_twin_follows_a_position_to_less_than_two_micrometres(noisy):
    """Slowly, so that fast encoders tell what is fast as well as they can."""
    problem, _ = noisy
    drawn = followed(problem, np.random.default_rng(2), 6)
    for x in problem.series:
        size = float(np.sqrt(np.mean(drawn[:, x.part] ** 2)))
        assert size == pytest.approx(FOLLOWED if x.quantity == "position" else 0.0, rel=0.3)
        if x.quantity == "position":
            steps = float(np.sqrt(np.mean(np.diff(drawn[:, x.part], axis=1) ** 2)))
            assert steps < size


def test_what_references_stand_above_the_floor_is_part_of_it():
    """Of a difference as large as theirs nothing is left, beside one of another signal all."""
    worn = record(effect("coulomb_friction", force=60.0), duration_s=10.0)
    alone = locate(worn, AXIS)
    beside = locate(worn, AXIS, healthy=alone)
    assert alone.roughness["axis.force"] > 2.0
    assert not beside.is_gap
    assert all(s.ratio < 1.1 for s in beside.signals)
    fine = locate(record(duration_s=10.0), AXIS)
    assert not fine.is_gap
    assert not fine.roughness
