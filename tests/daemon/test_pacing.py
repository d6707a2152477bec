"""Between the nodes of a motion shaped every 5 ms setpoints run smoothly, and arrive where it was meant."""

from __future__ import annotations

import numpy as np
import pytest

from hil.configfile import load_rig
from hil.control.shaping import CueShaper
from hil.daemon.core.pacing import PacedShaper
from hil.rigs import build_rig
from hil.signals import Cue, TimedPose
from tests.daemon.simulated_rig import rig_file


def follow(shaper, take, rig, seconds: float):
    """Positions, speeds and accelerations (k, 3, n) under cues of 50 Hz that jump about."""
    rng = np.random.default_rng(4)
    out = []
    take.reset(np.asarray(rig.parked_pose))
    shaper.follow()
    every = round(0.02 / rig.bus.cycle)
    for k in range(round(seconds / rig.bus.cycle)):
        now_s = k * rig.bus.cycle
        if k % every == 0:
            pose = tuple(
                (0.3 * rng.uniform(-1, 1, len(rig.limits)) * np.asarray(rig.limits)).tolist()
            )
            shaper.accept(Cue("c", k, now_s, now_s, (TimedPose(0.0, pose),)))
        r = take.step(now_s)
        assert r.t_s == pytest.approx(now_s + rig.bus.cycle)
        out.append((r.pose, r.velocity, r.acceleration))
    return np.array(out)


@pytest.mark.parametrize(("name", "every"), [("axis_canopen", 5), ("stewart_canopen", 2)])
def test_what_is_played_has_no_step_and_keeps_the_limits(name: str, every: int):
    rig = rig_file(name)
    paced = PacedShaper(rig, build_rig(rig))
    assert paced.every == every
    pose, velocity, acceleration = np.moveaxis(follow(paced.shaper, paced, rig, 1.5), 1, 0)
    v_max, a_max, j_max = (np.asarray(limit) for limit in rig.cue_limits())
    cycle_s = rig.bus.cycle
    assert np.all(np.abs(velocity).max(axis=0) > 0.05 * v_max), "it moves"
    assert np.all(np.abs(velocity) <= v_max * 1.001)
    assert np.all(np.abs(acceleration) <= a_max * 1.02)
    moved = np.diff(pose, axis=0)
    assert np.all(np.abs(moved) <= v_max * cycle_s * 1.001)
    assert np.abs(np.diff(velocity, axis=0)).max() <= a_max.max() * cycle_s * 1.02
    assert np.all(np.abs(np.diff(acceleration, axis=0)) <= 3.0 * j_max * cycle_s)
    middle = 0.5 * (velocity[1:] + velocity[:-1]) * cycle_s
    assert np.abs(moved - middle).max() < 1e-7, "speeds are those of the positions"


def test_every_fifth_setpoint_is_the_shapers_own():
    rig = rig_file("axis_canopen")
    paced = PacedShaper(rig, build_rig(rig))
    slow = rig.model_copy(update={"bus": rig.bus.model_copy(update={"cycle": 0.005})})
    alone = CueShaper(slow, build_rig(rig))
    played = follow(paced.shaper, paced, rig, 0.5)
    meant = follow(alone, alone, slow, 0.5)
    assert np.abs(played[4::5] - meant).max() < 1e-12


def test_a_rig_of_10_ms_is_shaped_in_each_cycle():
    rig = load_rig("axis")
    paced, alone = PacedShaper(rig, build_rig(rig)), CueShaper(rig, build_rig(rig))
    assert np.array_equal(follow(paced.shaper, paced, rig, 1.0), follow(alone, alone, rig, 1.0))


def test_it_rests_only_when_the_last_node_is_played():
    rig = rig_file("axis_canopen")
    paced = PacedShaper(rig, build_rig(rig))
    follow(paced.shaper, paced, rig, 0.3)
    paced.shaper.hold()
    speeds = []
    now_s = 0.3
    while not paced.at_rest:
        r = paced.step(now_s)
        now_s += rig.bus.cycle
        speeds.append(abs(float(r.velocity[0])))
        assert now_s < 3.0
    assert speeds[-1] < 1e-4
    stood = paced.step(now_s).pose
    assert paced.step(now_s + 0.001).pose == pytest.approx(stood, abs=1e-8)
