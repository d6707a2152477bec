"""Where drives are given forces, the twin is led by what was measured: what that leaves and what it hides."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from hil.config import RigFile
from hil.configfile import load_rig
from hil.gap.floor.draws import draws
from hil.gap.record.led import replay_led
from hil.gap.record.problem import Problem
from hil.gap.record.sides import sided
from hil.identify.replay import Stretch
from hil.sim import Twin
from hil.sim.twin import LEAD_TURN, LEAD_W, lead_w

AXIS = load_rig("axis")
SENT_S = np.arange(0.0, 6.0, AXIS.bus.cycle)
ANSWERED = {"axis.position": SENT_S[::2] + 0.0031, "axis.force": SENT_S[1::2] + 0.0031}


def pushed(rig: RigFile, forces: np.ndarray, noise_m: float = 0.0, seed: int = 1) -> Stretch:
    """A stretch of the axis under forces that no loop closes, as the twin answers them."""
    told = {"axis": (SENT_S, forces)}
    answers = Twin(rig, smooth=True).replay(told, ANSWERED, mode="force")
    rng = np.random.default_rng(seed)
    samples = {s: (t, answers[s] + 0.0) for s, t in ANSWERED.items()}
    t, x = samples["axis.position"]
    samples["axis.position"] = t, x + noise_m * rng.standard_normal(len(t))
    return Stretch("pushed", told, samples, "force")


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


def test_positions_that_are_far_apart_lead_more_slowly() -> None:
    assert lead_w(np.arange(0.0, 1.0, 0.001)) == LEAD_W
    assert lead_w(np.arange(0.0, 2.0, 0.06)) == pytest.approx(LEAD_TURN / 0.06)


@pytest.mark.parametrize("noise_m", [2e-5, 2e-4])
def test_the_floor_is_as_loud_as_what_noise_leaves_of_a_led_twin(noise_m: float) -> None:
    noise = AXIS.noise.model_copy(update={"position": noise_m, "position_step": 0.0})
    rig = AXIS.model_copy(update={"noise": noise})
    piece = pushed(rig, 60.0 * np.sin(2 * np.pi * 0.8 * SENT_S), noise_m)
    problem = Problem(rig, [piece])
    late, sensed = draws(problem, problem.base, np.random.default_rng(2), 6)
    (x,) = (x for x in problem.series if x.signal == "axis.position")
    left = problem.residual(problem.base)[x.part]
    assert np.std((late + sensed)[:, x.part]) == pytest.approx(np.std(left), rel=0.15)
    assert np.std(left) < 1.2 * noise_m


def test_an_answer_that_waited_stands_on_its_own_side_of_a_jump() -> None:
    forces = np.where(np.arange(len(SENT_S)) % 2 == 0, 100.0, -100.0)
    piece = pushed(AXIS, forces)
    t, answered = piece.samples["axis.force"]
    wait_s = np.where(np.arange(len(t)) % 3 == 0, 0.0021, 0.0)
    late = dataclasses.replace(
        piece, samples={**piece.samples, "axis.force": (t + wait_s, answered)}
    )
    for told in (piece, late):
        problem = Problem(AXIS, [told])
        (x,) = (x for x in problem.series if x.signal == "axis.force")
        left = problem.residual(problem.base)[x.part]
        assert np.max(np.abs(left)) < 3.0 * AXIS.noise.force
        assert len(left) > 0.9 * len(t)
    moved = sided(AXIS, late)
    again = sided(AXIS, moved)
    assert again.samples["axis.force"][0] == pytest.approx(moved.samples["axis.force"][0])


def test_a_force_between_two_that_were_set_says_nothing() -> None:
    piece = pushed(AXIS, np.where(np.arange(len(SENT_S)) % 2 == 0, 100.0, -100.0))
    t, answered = piece.samples["axis.force"]
    sampled = SENT_S[10] + AXIS.bus.setpoint_delay + AXIS.bus.answer_delay + 1e-4
    there = np.append(t[t < sampled], sampled), np.append(answered[t < sampled], 20.0)
    moved = sided(AXIS, dataclasses.replace(piece, samples={**piece.samples, "axis.force": there}))
    assert len(moved.samples["axis.force"][0]) == len(there[0]) - 1
