"""Where drives are given forces, the twin is led by what was measured: what that leaves and what it hides."""

from __future__ import annotations

import dataclasses

import numpy as np
import pandas as pd
import pytest

from hil.config import RigFile
from hil.configfile import load_rig
from hil.gap.catalogue.bank import fill_bank
from hil.gap.floor.draws import UNKNOWN, draws
from hil.gap.floor.noise import find_noise
from hil.gap.located.locate import locate
from hil.gap.record.leaf import Leaf, Start
from hil.gap.record.led import lacking, replay_led
from hil.gap.record.problem import Problem
from hil.gap.record.repeats import find_repeats
from hil.gap.record.sides import sided
from hil.gap.record.standstill import is_held
from hil.identify.replay import Stretch
from hil.sim import Twin
from hil.sim.twin import LEAD_TURN, LEAD_W, lead_w
from tests.gap.twin_runs import effect

AXIS = load_rig("axis")
SENT_S = np.arange(0.0, 6.0, AXIS.bus.cycle)
ANSWERED = {"axis.position": SENT_S[::2] + 0.0031, "axis.force": SENT_S[1::2] + 0.0031}


def pushed(
    rig: RigFile, forces: np.ndarray, noise_m: float = 0.0, seed: int = 1, jitter_s: float = 0.0
) -> Stretch:
    """A stretch of the axis under forces that no loop closes, as the twin answers them."""
    late_s = jitter_s * np.abs(np.random.default_rng(seed + 1).standard_normal(len(SENT_S)))
    told = {"axis": (SENT_S + late_s, forces)}
    answered = {
        "axis.position": ANSWERED["axis.position"] + late_s[::2],
        "axis.force": ANSWERED["axis.force"] + late_s[1::2],
    }
    answers = Twin(rig, smooth=True).replay(told, answered, mode="force")
    rng = np.random.default_rng(seed)
    samples = {s: (t, answers[s] + 0.0) for s, t in answered.items()}
    t, x = samples["axis.position"]
    samples["axis.position"] = t, x + noise_m * rng.standard_normal(len(t))
    return Stretch("pushed", told, samples, "force")


def as_frame(piece: Stretch) -> pd.DataFrame:
    """The stretch as a record."""
    columns = {"axis.force_setpoint": piece.setpoints["axis"], **piece.samples}
    each = [pd.DataFrame({"t": t, name: v}) for name, (t, v) in columns.items()]
    return pd.concat(each).groupby("t", as_index=False).first()


def test_a_twin_that_knows_all_is_not_led_anywhere() -> None:
    piece = pushed(AXIS, 60.0 * np.sin(2 * np.pi * 0.8 * SENT_S))
    led = replay_led(AXIS, piece, ANSWERED)
    for signal, values in led.by_signal(led.run()).items():
        assert values == pytest.approx(piece.samples[signal][1], abs=1e-9)


def test_a_force_that_it_does_not_know_stretches_the_spring_that_leads_it() -> None:
    """At rest the spring carries it: force = effective mass * lead_w^2 * error."""
    smooth = AXIS.model_copy(
        update={"actuators": tuple(a.model_copy(update={"coulomb": 0.0}) for a in AXIS.actuators)}
    )
    piece = pushed(smooth, np.zeros(len(SENT_S)))
    pulled = dataclasses.replace(piece, setpoints={"axis": (SENT_S, np.full(len(SENT_S), 40.0))})
    led = replay_led(smooth, pulled, ANSWERED)
    (end, *_) = led.by_signal(led.run())["axis.position"][::-1]
    stiffness = smooth.actuators[0].effective_mass * LEAD_W**2
    assert end == pytest.approx(40.0 / stiffness, rel=1e-3)


def test_the_floor_feels_half_a_force_sensors_noise_as_an_unknown_force() -> None:
    piece = pushed(AXIS, 60.0 * np.sin(2 * np.pi * 0.8 * SENT_S))
    problem = Problem(AXIS, [piece])
    late, _ = draws(problem, problem.base, np.random.default_rng(2), 6)
    (x,) = (x for x in problem.series if x.signal == "axis.position")
    stretched_m = UNKNOWN * AXIS.noise.force / (AXIS.actuators[0].effective_mass * LEAD_W**2)
    assert 0.3 < np.std(late[:, x.part]) / stretched_m < 1.0  # the spring follows slow forces whole


def test_what_a_led_twin_lacks_is_what_stretches_its_spring() -> None:
    t = np.arange(0.0, 3.0, 0.02)
    w, turn = lead_w(t), 2.0 * np.pi * 0.7
    pushed_by = np.cos(turn * t)
    answer = 1.0 / (
        w**2 - turn**2 + 2j * w * turn
    )  # of a spring and damper that are critically damped
    error = (answer * np.exp(1j * turn * t)).real
    assert lacking(t, error)[2:-2] == pytest.approx(pushed_by[2:-2], abs=0.02)


def test_positions_that_are_far_apart_lead_more_slowly() -> None:
    assert lead_w(np.arange(0.0, 1.0, 0.001)) == LEAD_W
    assert lead_w(np.arange(0.0, 2.0, 0.06)) == pytest.approx(LEAD_TURN / 0.06)


@pytest.mark.parametrize("noise_m", [2e-5, 2e-4])
def test_the_floor_is_as_loud_as_what_noise_leaves_of_a_led_twin(noise_m: float) -> None:
    changes = {"position": noise_m, "position_step": 0.0, "force": 1e-3}  # no force is unknown
    noise = AXIS.noise.model_copy(update=changes)
    rig = AXIS.model_copy(update={"noise": noise})
    piece = pushed(rig, 60.0 * np.sin(2 * np.pi * 0.8 * SENT_S), noise_m)
    problem = Problem(rig, [piece])
    late, sensed = draws(problem, problem.base, np.random.default_rng(2), 6)
    (x,) = (x for x in problem.series if x.signal == "axis.position")
    left = problem.residual(problem.base)[x.part]
    assert np.std((late + sensed)[:, x.part]) == pytest.approx(np.std(left), rel=0.15)
    assert np.std(left) < 1.2 * noise_m


@pytest.mark.parametrize(
    ("sensor", "parameter", "value"),
    [("sensor_bias", "offset", 1e-3), ("sensor_scale", "scale", 1.02), ("sensor_latency", "delay", 1e-3)],
)  # fmt: skip
def test_what_a_leading_sensor_errs_by_moves_the_twin(
    sensor: str, parameter: str, value: float
) -> None:
    """Its column is a replay, which it hardly changes: the twin is led to the answers, however wrong."""
    piece = pushed(AXIS, 60.0 * np.sin(2 * np.pi * 0.8 * SENT_S))
    problem, name = Problem(AXIS, [piece]), f"axis.position.{sensor}.{parameter}"
    base = problem.predict(problem.base)[0]
    leaf = Leaf(sensor, "axis.position", (name,), (Start({}, ({name: value},)),), "axis")
    column = fill_bank(problem, problem.base, base, [leaf]).columns[:, 0]
    row = np.array(problem.base)
    row[problem.table.index(name)] = value
    (moved,) = problem.changes(np.array([row]), problem.base, base)
    assert column == pytest.approx(moved, abs=1e-9)
    assert moved == pytest.approx(problem.answers(row)[0] - base, abs=5e-6)
    (x,) = (x for x in problem.series if x.signal == "axis.position")
    travel = float(np.ptp(base[x.part]))
    own = {"offset": value, "scale": 0.02 * travel, "delay": 1e-3 * travel * 2 * np.pi * 0.8}
    assert np.std(column[x.part]) < 0.5 * own[parameter]
    (slope,) = problem.jacobian([name], problem.base, base).T
    assert np.std(slope[x.part]) < 0.5 * own[parameter] / abs(value - (parameter == "scale"))


@pytest.fixture(scope="module")
def waited() -> Stretch:
    """Forces to and fro in each cycle, of whose answers every third waited for two milliseconds."""
    piece = pushed(AXIS, np.where(np.arange(len(SENT_S)) % 2 == 0, 100.0, -100.0))
    t, answered = piece.samples["axis.force"]
    late_s = np.where(np.arange(len(t)) % 3 == 0, 0.0083, 0.0)
    return dataclasses.replace(
        piece, samples={**piece.samples, "axis.force": (t + late_s, answered)}
    )


def test_an_answer_that_waited_stands_on_its_own_side_of_a_jump(waited: Stretch) -> None:
    problem = Problem(AXIS, [waited])
    (x,) = (x for x in problem.series if x.signal == "axis.force")
    left = problem.residual(problem.base)[x.part]
    assert np.max(np.abs(left)) < 3.0 * AXIS.noise.force
    assert len(left) == len(waited.samples["axis.force"][0])
    (again, _), (moved, _) = (
        p.samples["axis.force"] for p in (sided(AXIS, problem.sent[0]), problem.sent[0])
    )
    assert again == pytest.approx(moved)


def test_a_force_between_two_that_were_set_says_nothing(waited: Stretch) -> None:
    t, answered = waited.samples["axis.force"]
    on_its_way = np.where(np.arange(len(t)) == 30, 20.0, answered)
    moved = sided(
        AXIS, dataclasses.replace(waited, samples={**waited.samples, "axis.force": (t, on_its_way)})
    )
    assert len(moved.samples["axis.force"][0]) == len(t) - 1
    assert 20.0 not in moved.samples["axis.force"][1]


def test_answers_that_are_told_in_one_middle_are_one(waited: Stretch) -> None:
    """What follows takes slopes over time."""
    answered = waited.samples["axis.force"][1]
    soon = SENT_S[1::2] + AXIS.bus.setpoint_delay + AXIS.bus.answer_delay + 2e-4
    late = soon + np.where(np.arange(len(soon)) % 3 == 0, AXIS.bus.cycle + 2e-4, 0.0)
    twice = np.sort(np.concatenate([late, late + 1e-4])), np.repeat(answered, 2)
    t_s, value = sided(
        AXIS, dataclasses.replace(waited, samples={**waited.samples, "axis.force": twice})
    ).samples["axis.force"]
    assert len(t_s) == len(value)
    assert np.diff(t_s).min() > 0.5 * AXIS.bus.cycle


def test_forces_that_all_come_later_are_left_where_they_are(waited: Stretch) -> None:
    """A delay is the twin's to explain."""
    late = effect("transport_delay", delay=0.006)
    rig = AXIS.model_copy(update={"effects": (late,)})
    piece = pushed(rig, 60.0 * np.sin(2 * np.pi * 3.0 * SENT_S))
    assert sided(AXIS, piece).samples["axis.force"][0] == pytest.approx(
        piece.samples["axis.force"][0]
    )


def test_motion_is_not_judged_where_friction_holds_or_turns() -> None:
    piece = pushed(AXIS, 80.0 * np.sin(2 * np.pi * 0.5 * SENT_S))
    t, x = piece.samples["axis.position"]
    held = is_held(piece, ["axis"], t)
    slow = np.abs(np.gradient(x, t)) < 1e-3
    assert held[slow].all()
    assert not held[np.abs(np.gradient(x, t)) > 6e-3].any()
    moved = dataclasses.replace(piece, mode="position")
    assert not is_held(moved, ["axis"], t).any()


def test_motion_is_not_judged_until_a_twin_has_found_its_way_from_another_rest() -> None:
    rests = (SENT_S > 2.0) & (SENT_S < 3.5)
    piece = pushed(AXIS, np.where(rests, 0.0, 80.0 * np.sin(2 * np.pi * 0.5 * SENT_S)))
    t, x = piece.samples["axis.position"]
    rests_until = t[(t > 3.0) & (np.abs(x - x[np.searchsorted(t, 3.0)]) > 1e-3)][0]
    held = is_held(piece, ["axis"], t)
    assert held[(t > 3.0) & (t < rests_until + 0.3)].all()
    later = t[(t > rests_until) & ~held]
    assert later[0] < rests_until + 0.6
    assert (~held[(t > 0.2) & (t < 0.8)]).any(), "a turn is no rest"


def test_forces_that_come_again_elsewhere_are_no_repeats() -> None:
    """A push that grows carries the rig on, however alike its swings are."""
    noisy = 0.5 * np.random.default_rng(3).standard_normal(len(SENT_S))
    growing = np.where(SENT_S < 4.0, noisy, 400.0 * np.sin(2 * np.pi * 3.0 * SENT_S))
    assert find_repeats(Problem(AXIS, [pushed(AXIS, growing)])) == []


def test_motions_that_repeat_are_found_though_no_force_comes_twice() -> None:
    rng = np.random.default_rng(3)
    forces = 300.0 * np.sin(2 * np.pi * 1.0 * SENT_S) + 20.0 * rng.standard_normal(len(SENT_S))
    piece = pushed(AXIS, forces)
    t = piece.samples["axis.position"][0]
    again = t, 0.05 * np.sin(2 * np.pi * 1.0 * t) + 2e-5 * rng.standard_normal(len(t))
    piece = dataclasses.replace(piece, samples={**piece.samples, "axis.position": again})
    (found,) = find_repeats(Problem(AXIS, [piece]))
    assert "periods of 1 s" in found.text


def test_repeats_make_no_noise_of_set_forces_quieter_than_its_model() -> None:
    """A slow force that goes with place is the same in each repeat, and no gap."""
    piece = pushed(AXIS, 60.0 * np.sin(2 * np.pi * 1.0 * SENT_S))
    problem = Problem(AXIS, [piece])
    residual = 1e-7 * np.random.default_rng(5).standard_normal(problem.size)
    repeats, rng = find_repeats(problem), np.random.default_rng(2)
    assert repeats
    found = find_noise(problem, problem.base, rng, repeats=repeats, residual=residual, count=2)
    alone = find_noise(problem, problem.base, np.random.default_rng(2), residual=residual, count=2)
    assert found.source == "repeats"
    assert found.floor(problem)["axis.position"] == pytest.approx(
        alone.floor(problem)["axis.position"], rel=0.01
    )


def test_a_slope_within_a_levels_tolerance_is_no_gap_where_no_loop_hides_it() -> None:
    sloped = AXIS.model_copy(update={"effects": (effect("base_tilt", "platform", pitch=0.0015),)})
    piece = pushed(sloped, 60.0 * np.sin(2 * np.pi * 0.8 * SENT_S), AXIS.noise.position)
    found = locate(as_frame(piece), AXIS)
    assert not found.is_gap
    (slope,) = (n for n in found.nuisances if n.name == "platform.base_tilt.pitch")
    assert slope.change == pytest.approx(0.0015, abs=3e-4)
