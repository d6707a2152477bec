"""A whole ride as values: nothing clipped, every change and every violation told."""

from __future__ import annotations

import numpy as np
import pytest

from hil.configfile import load_rig
from hil.control.trajectory import CueTrajectory, check, fit
from hil.errors import RunError
from hil.rigs import build_rig

RIG = load_rig("motorcycle")
MANIPULATOR = build_rig(RIG)
NAMES = RIG.coordinates
V, A, J = RIG.cue_limits()


def ride(scale=1.0, hz=0.3, duration=10.0, rate=100.0):
    t = np.arange(0.0, duration, 1.0 / rate)
    w = 2.0 * np.pi * hz
    columns = [0.05 * np.sin(w * t), 0.04 * np.sin(w * t + 0.5), 0.06 * np.sin(w * t + 1.0)]
    return CueTrajectory(NAMES, t, scale * np.array(columns).T)


def test_a_fair_ride_breaks_nothing_and_is_left_alone():
    trajectory = ride()
    assert check(trajectory, RIG, MANIPULATOR) == ()
    fitted = fit(trajectory, RIG, MANIPULATOR)
    assert fitted.factors == (1.0, 1.0, 1.0)
    assert fitted.notes == ()
    assert np.array_equal(fitted.trajectory.poses, trajectory.poses)


def test_each_violation_is_told_with_coordinate_time_value_and_bound():
    trajectory = ride()
    bump = 0.24 * np.exp(-(((trajectory.t_s - 5.0) / 0.8) ** 2))
    poses = trajectory.poses.copy()
    poses[:, 2] = 1.2 * bump
    found = check(CueTrajectory(NAMES, trajectory.t_s, poses), RIG, MANIPULATOR)
    workspace = [v for v in found if v.rule == "workspace"]
    assert len(workspace) == 1
    assert workspace[0].name == "roll"
    assert workspace[0].t_s == pytest.approx(5.0)
    assert workspace[0].value == pytest.approx(0.288)
    assert workspace[0].bound == RIG.limits[2]
    assert "roll" in str(workspace[0])


def test_too_fast_a_ride_breaks_velocity_where_it_is_fast():
    found = check(ride(hz=2.0), RIG, MANIPULATOR)
    velocity = [v for v in found if v.rule == "velocity" and v.name == "yaw"]
    assert velocity
    for v in velocity:
        assert abs(v.value) == pytest.approx(0.05 * 2 * np.pi * 2.0, rel=0.03)
        assert abs(np.cos(2 * np.pi * 2.0 * v.t_s)) > 0.9


@pytest.mark.parametrize(("scale", "hz"), [(6.0, 0.3), (1.0, 3.0), (4.0, 1.0)])
def test_fit_scales_until_all_limits_are_kept_and_says_so(scale, hz):
    trajectory = ride(scale, hz)
    assert check(trajectory, RIG, MANIPULATOR)
    fitted = fit(trajectory, RIG, MANIPULATOR)
    assert check(fitted.trajectory, RIG, MANIPULATOR) == ()
    assert min(fitted.factors) < 1.0
    assert np.allclose(fitted.trajectory.poses, trajectory.poses * fitted.factors)
    for name, factor in zip(NAMES, fitted.factors, strict=True):
        if factor < 1.0:
            assert any(note.startswith(f"{name}: scaled by {factor:.3f}") for note in fitted.notes)


def test_fit_keeps_the_speed_from_row_to_row_that_the_guard_looks_at():
    t = np.arange(0.0, 5.0, 0.02)
    roll = 0.3 * np.sin(0.6 * t) * (t > 2.0)
    sharp = CueTrajectory(NAMES, t, np.outer(roll, [0.0, 0.0, 1.0])).low_passed(3.0)
    fastest = np.max(np.abs(np.diff(fit(sharp, RIG, MANIPULATOR).trajectory.poses, axis=0))) / 0.02
    assert fastest <= V[2]


def test_fit_keeps_actuators_limits_that_coordinates_do_not_show():
    legs = tuple(
        a.model_copy(update={"stroke": (0.57, 0.63)}) if a.name != "slide" else a
        for a in RIG.actuators
    )
    rig = RIG.model_copy(update={"actuators": legs})
    manipulator = build_rig(rig)
    found = check(ride(), rig, manipulator)
    assert {v.rule for v in found} == {"stroke"}
    fitted = fit(ride(), rig, manipulator)
    assert check(fitted.trajectory, rig, manipulator) == ()
    assert 0.3 < fitted.factors[0] < 1.0
    assert any("stroke of leg" in note for note in fitted.notes)


def test_filtering_is_told_and_has_no_delay():
    trajectory = ride()
    rng = np.random.default_rng(2)
    noisy = CueTrajectory(
        NAMES, trajectory.t_s, trajectory.poses + 1e-3 * rng.normal(size=trajectory.poses.shape)
    )
    fitted = fit(noisy, RIG, MANIPULATOR, cutoff_hz=2.0)
    assert fitted.cutoff_hz == 2.0
    assert sum("low-passed at 2 Hz" in note for note in fitted.notes) == 3
    middle = slice(100, -100)
    error = fitted.trajectory.poses[middle] / fitted.factors - trajectory.poses[middle]
    speed = np.gradient(trajectory.poses, 0.01, axis=0)[middle]
    delay = -np.sum(error * speed, axis=0) / np.sum(speed**2, axis=0)
    assert np.abs(delay).max() < 0.002
    assert np.std(error) < 4e-4


def test_resampling_an_uneven_log_keeps_its_values():
    rng = np.random.default_rng(4)
    t = np.sort(rng.uniform(0.0, 10.0, 800))
    t = t[np.concatenate([[True], np.diff(t) > 1e-4])]
    poses = np.array([np.sin(t), np.cos(t), 0.1 * t]).T
    even = CueTrajectory(NAMES, t, poses).resampled(100.0)
    assert np.diff(even.t_s) == pytest.approx(0.01)
    assert np.abs(even.poses[:, 0] - np.sin(even.t_s)).max() < 2e-3
    assert even.poses.max() <= poses.max() + 1e-12


def test_what_is_no_trajectory_is_refused_with_its_row():
    t = np.arange(5.0)
    poses = np.zeros((5, 3))
    with pytest.raises(RunError, match="shape"):
        CueTrajectory(NAMES, t, np.zeros((5, 2)))
    bad = poses.copy()
    bad[3, 1] = np.nan
    with pytest.raises(RunError, match="row 3"):
        CueTrajectory(NAMES, t, bad)
    with pytest.raises(RunError, match="row 2"):
        CueTrajectory(NAMES, np.array([0.0, 1.0, 1.0, 2.0, 3.0]), poses)
    with pytest.raises(RunError, match="resample"):
        CueTrajectory(NAMES, np.array([0.0, 1.0, 1.5, 2.0, 3.0]), poses).derivatives()
    with pytest.raises(RunError, match="cut-off"):
        CueTrajectory(NAMES, t, poses).low_passed(0.6)
    with pytest.raises(RunError, match="needs"):
        check(CueTrajectory(("a", "b", "c"), t, poses), RIG, MANIPULATOR)
