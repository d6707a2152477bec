"""Whatever comes in, what goes out keeps every limit; a fair cue is followed without lag."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hil.config import RigFile
from hil.configfile import load_rig
from hil.control import CueGuard, CueShaper
from hil.errors import LimitViolation
from hil.rigs import build_rig
from hil.signals import Cue, TimedPose

RIG = load_rig("motorcycle")
MANIPULATOR = build_rig(RIG)
DT = RIG.bus.cycle
V, A, J = (np.array(x) for x in RIG.cue_limits())


class Stream:
    """A shaper fed with a function of time, sampled at `rate_hz`, perhaps with poses ahead."""

    def __init__(self, pose_at, rate_hz=100.0, ahead_s=0.0, rig: RigFile = RIG) -> None:
        self.shaper = CueShaper(rig, build_rig(rig))
        self.guard = CueGuard(rig)
        self.pose_at = pose_at
        self.period = 1.0 / rate_hz
        self.ahead = ahead_s
        self.seq = 0
        self.step = 0
        self.out = []

    def run(self, duration_s, *, cues=True):
        for _ in range(round(duration_s / DT)):
            now = self.step * DT
            while cues and self.seq * self.period <= now:
                t = self.seq * self.period
                steps = 1 + round(self.ahead / self.period)
                poses = tuple(
                    TimedPose(k * self.period, tuple(map(float, self.pose_at(t + k * self.period))))
                    for k in range(steps)
                )
                verdict = self.guard.check(Cue("sim", self.seq, 500.0 + t, now, poses), now)
                if verdict.cue is not None:
                    self.shaper.accept(verdict.cue)
                self.seq += 1
            self.out.append(self.shaper.step(now))
            self.step += 1
        return self

    def arrays(self):
        t = np.array([r.t_s for r in self.out])
        p, v, a = (
            np.array([getattr(r, k) for r in self.out])
            for k in ("pose", "velocity", "acceleration")
        )
        return t, p, v, a


def assert_within_limits(p, v, a, rig=RIG, start=None):
    velocity, acceleration, jerk = (np.array(x) for x in rig.cue_limits())
    assert np.all(np.isfinite(p))
    assert np.all(np.abs(p) <= np.array(rig.limits) + 1e-8)
    assert np.all(np.abs(v) <= velocity * (1 + 1e-6) + 1e-9)
    assert np.all(np.abs(a) <= acceleration * (1 + 1e-6) + 1e-9)
    before = np.zeros((1, p.shape[1]))
    da = np.diff(np.vstack([before, a]), axis=0)
    assert np.all(np.abs(da) <= jerk * rig.bus.cycle * (1 + 1e-6) + 1e-9)
    # Positions, velocities and accelerations are those of one motion.
    start = np.zeros(p.shape[1]) if start is None else start
    dp = np.diff(np.vstack([start, p]), axis=0)
    mean = 0.5 * (v + np.vstack([before, v[:-1]]))
    assert np.all(np.abs(dp - DT * mean) <= jerk * DT**3)


def ride(t):
    return np.array([0.05 * np.sin(2.5 * t), 0.04 * np.sin(3.0 * t), 0.06 * np.sin(2.0 * t + 1.0)])


@pytest.mark.parametrize(("rate_hz", "ahead_s"), [(100.0, 0.0), (60.0, 0.0), (50.0, 0.1)])
def test_a_fair_cue_is_followed_without_lag(rate_hz, ahead_s):
    stream = Stream(ride, rate_hz, ahead_s)
    stream.shaper.follow()
    t, p, v, a = stream.run(8.0).arrays()
    assert_within_limits(p, v, a)
    wanted = np.array([ride(x) for x in t])
    settled = t > RIG.cue.ramp_in + 0.5
    error = (p - wanted)[settled]
    speed = np.gradient(wanted, DT, axis=0)[settled]
    lag = -np.sum(error * speed, axis=0) / np.sum(speed**2, axis=0)
    assert np.all(np.abs(lag) < 0.001)
    assert np.max(np.abs(error)) < 6e-4
    assert not stream.shaper.counts


def test_following_does_not_add_shake_to_a_smooth_cue():
    stream = Stream(ride, 100.0, 0.1)
    stream.shaper.follow()
    t, _, _, a = stream.run(8.0).arrays()
    settled = (t > 3.0) & (t < 7.9)
    wanted = np.array([ride(x) for x in t])
    true = np.gradient(np.gradient(wanted, DT, axis=0), DT, axis=0)
    assert np.max(np.abs(a - true)[settled]) < 0.15 * np.max(np.abs(true))


@pytest.mark.parametrize(
    "goal",
    [
        (0.0014, -0.0050, 0.0143),  # a centimetre of one leg
        (0.006, 0.003, -0.004),
        (-0.05, 0.03, 0.07),
        (0.10, -0.12, 0.02),
    ],
)
def test_a_jump_of_the_cue_is_met_without_swinging_about_it(goal):
    goal = np.array(goal)
    shaper, guard = CueShaper(RIG, MANIPULATOR), CueGuard(RIG)
    shaper.follow()
    poses = []
    for k in range(550):
        now = DT * k
        if k % 2 == 0:
            asked = tuple((goal if k >= 400 else 0.0 * goal).tolist())
            held = tuple(TimedPose(0.02 * j, asked) for j in range(6))
            shaper.accept(guard.check(Cue("sim", k, now, now, held), now).cue)
        poses.append(shaper.step(now).pose)
    share = np.array(poses[400:]) / goal
    assert share.max() < 1.1
    assert np.all(np.abs(share[60:] - 1.0) < 0.02)


def test_a_client_begins_softly():
    stream = Stream(lambda t: np.array([0.0, 0.1, 0.0]))
    stream.shaper.follow()
    t, p, v, _ = stream.run(4.0).arrays()
    assert p[t <= 0.1 * RIG.cue.ramp_in, 1].max() < 0.002
    assert p[-1, 1] == pytest.approx(0.1, abs=1e-4)
    # A quintic ramp of 0.1 in ramp_in peaks at 1.875 of its mean speed.
    assert v[:, 1].max() == pytest.approx(1.875 * 0.1 / RIG.cue.ramp_in, rel=0.02)


def test_a_client_that_resumes_begins_softly_again():
    stream = Stream(lambda t: np.array([0.0, 0.1, 0.0]))
    stream.shaper.follow()
    stream.run(4.0)
    stream.run(0.5, cues=False)
    stream.pose_at = lambda t: np.array([0.0, -0.1, 0.0])
    stream.seq = round(stream.step * DT / stream.period)
    _, _, v, _ = stream.run(4.0).arrays()
    resumed = v[450:]
    assert np.abs(resumed[:, 1]).max() == pytest.approx(1.875 * 0.2 / RIG.cue.ramp_in, rel=0.03)


def test_a_step_is_taken_as_fast_as_limits_allow():
    stream = Stream(lambda t: np.array([0.0, 0.0 if t < 4.0 else 0.2, 0.0]))
    stream.shaper.follow()
    t, p, v, a = stream.run(6.0).arrays()
    assert_within_limits(p, v, a)
    assert v[:, 1].max() == pytest.approx(V[1], rel=1e-3)
    quickest = 0.2 / V[1] + V[1] / A[1] + A[1] / J[1]
    arrived = t[np.argmax(p[:, 1] > 0.199)] - 4.0
    assert quickest - 0.08 < arrived < quickest + 0.06
    assert p[:, 1].max() < 0.2 + 1e-4
    assert stream.shaper.counts["cue_limits:pitch"] > 0


def test_a_cue_beyond_the_workspace_stops_at_its_edge():
    rig = RIG
    stream = Stream(lambda t: np.array([0.24 * t, 0.0, 0.0]))
    stream.shaper.follow()
    _, p, v, a = stream.run(4.0).arrays()
    assert_within_limits(p, v, a)
    assert p[-1, 0] == pytest.approx(rig.limits[0], abs=1e-3)


@given(
    points=st.lists(
        st.tuples(
            st.integers(1, 30),
            *[st.floats(-0.4, 0.4, allow_nan=False) for _ in range(3)],
            st.sampled_from(["follow", "hold", "park", "stay", "gain"]),
        ),
        min_size=3,
        max_size=15,
    ),
    ahead=st.sampled_from([0.0, 0.1]),
)
@settings(max_examples=60, deadline=None)
def test_no_cue_and_no_command_breaks_a_limit(points, ahead):
    target = [np.zeros(3)]
    stream = Stream(lambda t: target[0], 100.0, ahead)
    stream.shaper.follow()
    for cycles, yaw, pitch, roll, command in points:
        target[0] = np.array([yaw, pitch, roll])
        if command == "park":
            stream.shaper.park()
        elif command == "gain":
            stream.shaper.set_gain(abs(yaw))
        elif command != "stay":
            getattr(stream.shaper, command)()
        stream.run(cycles * DT)
    stream.shaper.park()
    stream.run(4.0, cues=False)
    _, p, v, a = stream.arrays()
    assert_within_limits(p, v, a)
    for q, qd in zip(p, v, strict=True):
        speed = np.abs(MANIPULATOR.rates(q, qd))
        assert np.all(speed <= [0.95 * x.velocity_max + 1e-6 for x in RIG.actuators])
    assert stream.shaper.at_parked


def slow_legs() -> RigFile:
    """Legs so slow and short that they, not the coordinates, set the limits."""
    legs = [
        a.model_copy(update={"velocity_max": 0.1, "stroke": (0.5, 0.7), "acceleration_max": 3.0})
        if a.name != "slide"
        else a
        for a in RIG.actuators
    ]
    return RIG.model_copy(update={"actuators": tuple(legs)})


def test_actuators_limits_slow_the_motion_down_and_are_named():
    rig = slow_legs()
    manipulator = build_rig(rig)
    stream = Stream(
        lambda t: np.array([0.0, 0.24 * np.sin(1.2 * t), 0.24 * np.sin(1.7 * t)]), rig=rig
    )
    stream.shaper.follow()
    _, p, v, a = stream.run(12.0).arrays()
    assert_within_limits(p, v, a, rig)
    rho = np.array([manipulator.inverse(q) for q in p])
    speed = np.array([manipulator.rates(q, qd) for q, qd in zip(p, v, strict=True)])
    acceleration = np.array([manipulator.accelerations(*x) for x in zip(p, v, a, strict=True)])
    margin = rig.safety.stroke_margin
    assert rho[:, :2].min() >= 0.5 + margin - 1e-6
    assert rho[:, :2].max() <= 0.7 - margin + 1e-6
    assert np.abs(speed[:, :2]).max() <= 0.1 * 0.95 + 1e-6
    assert np.abs(acceleration[:, :2]).max() <= 3.0 + 1e-6
    rules = {name.split(":")[0] for name in stream.shaper.counts}
    assert {"actuator_speed", "stroke"} <= rules
    # Slowed down, not given up: the legs still move through most of what they may.
    assert np.ptp(rho[:, 0]) > 0.12


def test_acceleration_that_actuators_never_allow_is_left_out_from_the_start():
    share = CueShaper(slow_legs(), MANIPULATOR).acceleration_share
    assert 0.0 < share < 0.5
    assert CueShaper(RIG, MANIPULATOR).acceleration_share == 1.0


@pytest.mark.parametrize("share", [0.1, 0.3, 1.0])
def test_parking_ends_at_rest_in_the_parked_pose_from_full_motion(share):
    stream = Stream(ride)
    stream.shaper.follow()
    stream.run(5.0)
    stream.shaper.park(share)
    already = abs(stream.out[-1].velocity)
    stream.run(8.0, cues=False)
    _, p, v, a = stream.arrays()
    assert_within_limits(p, v, a)
    assert stream.shaper.at_parked
    # Once slowed down to it, parking keeps to its share of the speed.
    late = np.abs(v[540:])
    assert np.all(late <= np.maximum(share * V, already) + 1e-6)
    assert np.allclose(p[-1], RIG.parked_pose, atol=1e-6)


def test_hold_stops_and_stays():
    stream = Stream(ride)
    stream.shaper.follow()
    stream.run(4.0)
    stream.shaper.hold()
    stream.run(1.0)
    _, p, v, a = stream.arrays()
    assert_within_limits(p, v, a)
    assert stream.shaper.at_rest
    assert not stream.shaper.at_parked
    assert np.ptp(p[-50:], axis=0).max() == 0.0


def test_master_gain_lowers_motion_smoothly():
    stream = Stream(lambda t: np.array([0.0, 0.2, 0.0]))
    stream.shaper.follow()
    stream.run(4.0)
    stream.shaper.set_gain(0.5)
    stream.run(4.0)
    _, p, v, a = stream.arrays()
    assert p[-1, 1] == pytest.approx(0.1, abs=2e-4)
    assert_within_limits(p, v, a)
    assert "cue_limits:pitch" not in stream.shaper.counts
    with pytest.raises(LimitViolation, match="gain"):
        stream.shaper.set_gain(1.1)


def test_a_rig_that_stands_outside_its_workspace_can_come_home():
    shaper = CueShaper(RIG, MANIPULATOR)
    start = np.array([0.0, 0.28, 0.0])
    shaper.reset(start)
    assert np.allclose(shaper.step(0.0).pose, start)
    shaper.park(1.0)
    poses = [shaper.step(DT * k).pose for k in range(400)]
    assert max(p[1] for p in poses) <= 0.28 + 1e-9
    assert shaper.at_parked


def test_a_pose_that_is_not_finite_cannot_be_started_from():
    with pytest.raises(LimitViolation, match="finite"):
        CueShaper(RIG, MANIPULATOR).reset(np.array([0.0, np.nan, 0.0]))


def test_a_cue_that_is_known_ahead_is_met_without_the_lag_of_a_guess():
    """Three swings a second: a client that sends its next 80 ms is followed several times closer."""
    rig = load_rig("motorcycle")
    hz, amplitude = 3.0, 0.004

    def wanted(t_s):
        ease = min(max(t_s - 3.0, 0.0), 1.0)
        swing = amplitude * ease**3 * (10 - 15 * ease + 6 * ease**2)
        return (0.0, swing * np.sin(2 * np.pi * hz * t_s), 0.0)

    def worst(ahead_s):
        shaper = CueShaper(rig, build_rig(rig))
        shaper.reset(np.zeros(3))
        shaper.follow()
        errors = []
        for k in range(600):
            now_s = k * rig.bus.cycle
            offsets = np.arange(0.0, ahead_s + 1e-9, 0.005)
            poses = tuple(TimedPose(float(d), wanted(now_s + d)) for d in offsets)
            shaper.accept(Cue("c", k, now_s, now_s, poses))
            made = shaper.step(now_s)
            errors.append(abs(made.pose[1] - wanted(made.t_s)[1]))
        assert not shaper.counts
        return max(errors[420:]) / amplitude

    assert worst(0.08) < 1e-9 < 0.01 < worst(0.02)
