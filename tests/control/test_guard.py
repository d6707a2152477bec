"""Every bad cue gets a verdict with a name, and none of them reaches shaping unlimited."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from hil.configfile import load_rig
from hil.control import CueGuard
from hil.signals import Cue, TimedPose

RIG = load_rig("motorcycle")


def cue(seq=0, t=10.0, received=1.0, client="sim", poses=((0.0, (0.0, 0.0, 0.0)),)):
    return Cue(client, seq, t, received, tuple(TimedPose(dt, p) for dt, p in poses))


@pytest.fixture
def guard():
    return CueGuard(RIG)


def test_a_good_stream_is_accepted(guard):
    for k in range(50):
        verdict = guard.check(
            cue(k, 10.0 + 0.01 * k, 1.0 + 0.01 * k, poses=((0.0, (0.0, 0.001 * k, 0.0)),)),
            1.0 + 0.01 * k,
        )
        assert verdict.name == "accepted"
    assert guard.counts == {"accepted": 50}
    assert guard.active_client(1.5) == "sim"


@pytest.mark.parametrize(
    ("bad", "name"),
    [
        (cue(poses=((0.0, (0.0, math.nan, 0.0)),)), "refused:not_finite"),
        (cue(poses=((0.0, (0.0, math.inf, 0.0)),)), "refused:not_finite"),
        (cue(poses=((0.0, (0.0, 0.0)),)), "refused:coordinates"),
        (cue(poses=()), "refused:malformed"),
        (cue(poses=tuple((0.001 * k, (0.0, 0.0, 0.0)) for k in range(257))), "refused:malformed"),
        (cue(poses=((-0.1, (0.0, 0.0, 0.0)),)), "refused:malformed"),
        (cue(poses=((0.1, (0.0,) * 3), (0.1, (0.0,) * 3))), "refused:malformed"),
        (cue(poses=((math.nan, (0.0,) * 3),)), "refused:malformed"),
        (cue(t=math.nan), "refused:malformed"),
        (cue(t=-1e308), "refused:clock"),
        (cue(t=1.1e11), "refused:clock"),
        (cue(seq=-1), "refused:malformed"),
        (replace(cue(), seq=True), "refused:malformed"),
    ],
)
def test_senseless_cues_are_refused_by_name(guard, bad, name):
    verdict = guard.check(bad, 1.0)
    assert verdict.name == name
    assert verdict.cue is None
    assert not verdict.is_accepted
    assert "sim" in verdict.text
    assert guard.counts == {name: 1}
    assert guard.active_client(1.0) is None


@pytest.mark.parametrize(
    ("late", "name"),
    [
        (cue(5, 10.01, 1.01), "refused:duplicate"),
        (cue(4, 10.01, 1.01), "refused:order"),
        (cue(6, 10.0, 1.01), "refused:time"),
        (cue(6, 9.0, 1.01), "refused:time"),
        (cue(6, 10.01, 1.01, client="other"), "refused:client"),
    ],
)
def test_sequence_and_client_are_kept(guard, late, name):
    assert guard.check(cue(5), 1.0).name == "accepted"
    assert guard.check(late, 1.01).name == name
    assert guard.check(cue(7, 10.02, 1.02), 1.02).name == "accepted"


def test_another_client_may_begin_when_the_first_is_stale(guard):
    guard.check(cue(5), 1.0)
    stale = 1.0 + RIG.cue.stale
    assert guard.check(cue(0, 3.0, stale, client="other"), stale).name == "refused:client"
    later = stale + 0.001
    assert guard.check(cue(0, 3.0, later, client="other"), later).name == "accepted"
    assert guard.active_client(later) == "other"


def test_refused_cues_do_not_keep_a_client_alive(guard):
    guard.check(cue(5), 1.0)
    for k in range(40):
        now = 1.0 + 0.01 * k
        guard.check(cue(6, 11.0 + k, now, poses=((0.0, (math.nan,) * 3),)), now)
    assert guard.active_client(1.4) is None
    assert guard.age_s(1.4) == pytest.approx(0.4)


def test_poses_outside_the_workspace_are_moved_onto_its_limit(guard):
    verdict = guard.check(cue(poses=((0.0, (0.5, -0.5, 0.1)),)), 1.0)
    assert verdict.name == "limited:workspace"
    assert verdict.cue.poses[0].pose == (0.26, -0.26, 0.1)
    assert "0.26" in verdict.text


def test_what_lies_just_outside_a_limit_is_told_with_the_digits_that_show_it(guard):
    limit = RIG.limits[1]
    outside = math.nextafter(limit, 1.0)
    verdict = guard.check(cue(poses=((0.0, (0.0, outside, 0.0)),)), 1.0)
    assert f"pitch = {outside!r} lies outside ±{limit!r}" in verdict.text
    verdict = guard.check(cue(seq=1, t=100000000000.5), 1.0)
    assert "t = 100000000000.5 s lies outside ±100000000000.0 s" in verdict.text


def test_a_pose_exactly_on_the_limit_is_accepted(guard):
    assert guard.check(cue(poses=((0.0, (0.26, -0.26, 0.26)),)), 1.0).name == "accepted"


def test_poses_too_far_ahead_are_dropped(guard):
    poses = tuple((0.3 * k, (0.0, 0.0, 0.0)) for k in range(4))
    verdict = guard.check(cue(poses=poses), 1.0)
    assert verdict.name == "limited:future"
    assert [p.dt_s for p in verdict.cue.poses] == [0.0, 0.3]


def test_too_fast_is_noticed_between_cues_and_within_one(guard):
    most = 0.1 * RIG.cue_limits()[0][2]
    fast = cue(poses=((0.0, (0.0, 0.0, 0.0)), (0.1, (0.0, 0.0, 1.02 * most))))
    assert guard.check(fast, 1.0).name == "limited:velocity"
    guard = CueGuard(RIG)
    guard.check(cue(0), 1.0)
    within = cue(1, 10.1, 1.1, poses=((0.0, (0.0, 0.0, 0.98 * most)),))
    assert guard.check(within, 1.1).name == "accepted"
    beyond = cue(2, 10.2, 1.2, poses=((0.0, (0.0, 0.0, 2.0 * most)),))
    verdict = guard.check(beyond, 1.2)
    assert verdict.name == "limited:velocity"
    assert "roll" in verdict.text
