"""Poses on our clock: jitter out, interpolation in, steps that stay steps."""

from __future__ import annotations

import numpy as np
import pytest

from hil.control.track import ClientClock, CueTrack
from hil.signals import Cue, TimedPose

V_MAX = np.array([1.0])


def cue(t_client, received, *poses, seq=0):
    timed = tuple(TimedPose(dt, (p,)) for dt, p in poses)
    return Cue("sim", seq, t_client, received, timed)


def test_clock_offset_is_the_smallest_delay_seen():
    clock = ClientClock()
    delays = [0.010, 0.004, 0.013, 0.006]
    offsets = [clock.observe(100.0 + k, 5.0 + k + d) for k, d in enumerate(delays)]
    assert offsets == pytest.approx([-94.990, -94.996, -94.996, -94.996])


def test_clock_offset_follows_a_client_whose_clock_runs_slow():
    clock = ClientClock()
    drift = 1.0e-3
    for k in range(4000):
        received = 0.01 * k
        offset = clock.observe(received * (1.0 - drift), received)
    assert received * drift - 10.0 * drift <= offset <= received * drift


def test_network_jitter_does_not_become_motion():
    rng = np.random.default_rng(1)
    track = CueTrack(V_MAX, 0.5)
    worst = 0.0
    arrivals = []
    for k in range(400):
        t = 0.01 * k
        arrivals.append((t + 0.002 + rng.exponential(0.003), t))
    for k, (received, t) in enumerate(sorted(arrivals)):
        # Poses are planned 50 ms ahead, so jitter is the only thing that could shake the target.
        poses = [(0.01 * j, 0.1 * np.sin(2.0 * (t + 0.01 * j))) for j in range(6)]
        if t > 1.0:
            before, _, _ = track.target(received)
            worst = max(worst, abs(before[0] - 0.1 * np.sin(2.0 * (received - 0.002))))
        track.add(cue(t, received, *poses, seq=k))
    assert worst < 0.1 * 2.0 * 0.0005


def test_poses_ahead_are_followed_smoothly_with_speed_and_acceleration():
    track = CueTrack(V_MAX, 0.5)
    track.add(cue(0.0, 0.0, *[(0.02 * j, 0.1 * np.sin(3.0 * 0.02 * j)) for j in range(20)]))
    for t in np.linspace(0.05, 0.3, 40):
        p, v, a = track.target(t)
        assert p[0] == pytest.approx(0.1 * np.sin(3.0 * t), abs=1e-6)
        assert v[0] == pytest.approx(0.3 * np.cos(3.0 * t), abs=1e-3)
        assert a[0] == pytest.approx(-0.9 * np.sin(3.0 * t), abs=0.1)


def test_a_steady_stream_is_extrapolated_with_its_speed():
    track = CueTrack(V_MAX, 0.5)
    for k in range(10):
        track.add(cue(0.02 * k, 0.02 * k, (0.0, 0.5 * 0.02 * k), seq=k))
    p, v, a = track.target(0.18 + 0.015)
    assert p[0] == pytest.approx(0.5 * 0.195)
    assert v[0] == pytest.approx(0.5)
    assert a[0] == pytest.approx(0.0, abs=1e-9)


def test_when_cues_stop_the_target_comes_to_rest():
    track = CueTrack(V_MAX, 0.5)
    for k in range(10):
        track.add(cue(0.02 * k, 0.02 * k, (0.0, 0.5 * 0.02 * k), seq=k))
    p1, v1, a1 = track.target(0.4)
    p2, _, _ = track.target(0.9)
    assert v1[0] == a1[0] == 0.0
    assert p1[0] == p2[0] == pytest.approx(0.09 + 0.5 * 0.12)


def test_a_step_leaves_a_resting_target_and_no_kick():
    track = CueTrack(V_MAX, 0.5)
    for k in range(10):
        track.add(cue(0.02 * k, 0.02 * k, (0.0, 0.0 if k < 9 else 0.1), seq=k))
    p, v, a = track.target(0.20)
    assert (p[0], v[0], a[0]) == (0.1, 0.0, 0.0)


def test_a_later_cue_replaces_what_was_planned():
    track = CueTrack(V_MAX, 0.5)
    track.add(cue(0.0, 0.0, (0.0, 0.0), (0.1, 0.05), (0.2, 0.1), seq=0))
    track.add(cue(0.05, 0.05, (0.0, 0.0), (0.1, 0.0), (0.2, 0.0), seq=1))
    p, v, _ = track.target(0.2)
    assert p[0] == pytest.approx(0.0, abs=1e-12)
    assert v[0] == pytest.approx(0.0, abs=1e-12)


def test_poses_too_far_ahead_are_not_kept():
    track = CueTrack(V_MAX, 0.5)
    track.add(cue(0.0, 0.0, (0.0, 0.0), (0.4, 0.1), (0.6, 0.2)))
    assert track.newest_s == pytest.approx(0.4)
