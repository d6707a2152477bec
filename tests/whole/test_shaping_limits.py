"""What shaping must do whatever the cue does, and must not do to a cue that asks for nothing forbidden."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hil.config import RigFile
from hil.configfile import load_rig
from hil.control import CueGuard, CueShaper
from hil.rigs import build_rig
from hil.signals import Cue, TimedPose
from tests.control.test_shaping import assert_within_limits

RIG = load_rig("motorcycle")
DT = RIG.bus.cycle
V, A, J = (np.array(x) for x in RIG.cue_limits())
QUIET_S = 1.0 + RIG.cue.ramp_in
Pose = Callable[[np.ndarray], np.ndarray]
"""Poses (k, 3) at times (k,)."""


def multisine(hz: float, share: float, seed: int) -> Pose:
    """Random phases on a quarter-hertz raster up to `hz`; each coordinate uses `share` of a limit."""
    rng = np.random.default_rng(seed)
    w = 2.0 * np.pi * np.arange(1, int(4.0 * hz) + 1) / 4.0
    phase = rng.uniform(0.0, 2.0 * np.pi, (3, len(w)))
    amplitude = w**-1.5

    def waves(t: np.ndarray, order: int) -> np.ndarray:
        angle = t[:, None, None] * w + phase + 0.5 * np.pi * order
        return np.sum(amplitude * w**order * np.cos(angle), axis=2)

    t = np.arange(0.0, 4.0, 2e-3)
    peaks = [np.max(np.abs(waves(t, order)), axis=0) for order in range(4)]
    bounds = (0.8 * np.array(RIG.limits), V, A, J)
    # Legs share what three coordinates ask for at once.
    gain = share * np.min([b / p for b, p in zip(bounds, peaks, strict=True)], axis=0)
    return lambda t: gain * waves(t, 0)


def after_a_rest(pose: Pose) -> Pose:
    """`pose`, faded in over two seconds once the soft start is over."""

    def faded(t: np.ndarray) -> np.ndarray:
        u = np.clip((t - QUIET_S) / 2.0, 0.0, 1.0)[:, None]
        return pose(t) * u**4 * (35.0 - 84.0 * u + 70.0 * u**2 - 20.0 * u**3)

    return faded


@dataclass
class Play:
    """A client that knows `pose` for the next 100 ms, and the shaper that follows it."""

    pose: Pose
    spacing_s: float = DT
    client_starts_s: float = 0.0
    delay_s: Callable[[int], float] = lambda k: 0.0
    sending: bool = True
    cycle: int = 0
    sent: int = 0
    rig: RigFile = RIG
    made: list = field(default_factory=list)
    held_back: list = field(default_factory=list)

    def __post_init__(self) -> None:
        self.shaper, self.guard = CueShaper(self.rig, build_rig(self.rig)), CueGuard(self.rig)
        self.shaper.follow()

    def run(self, seconds: float) -> Play:
        offsets = np.arange(0.0, 0.1 + 1e-9, self.spacing_s)
        for _ in range(round(seconds / DT)):
            now = self.cycle * DT
            while self.sending and self.sent * 0.02 + self.delay_s(self.sent) <= now + 1e-9:
                t = self.sent * 0.02
                poses = self.pose(t + offsets).tolist()
                timed = [
                    TimedPose(d, tuple(p)) for d, p in zip(offsets.tolist(), poses, strict=True)
                ]
                cue = Cue("sim", self.sent, self.client_starts_s + t, now, tuple(timed))
                verdict = self.guard.check(cue, now)
                if verdict.cue is not None:
                    self.shaper.accept(verdict.cue)
                self.sent += 1
            self.made.append(self.shaper.step(now))
            self.cycle += 1
        return self

    def arrays(self) -> tuple[np.ndarray, ...]:
        columns = [(r.t_s, r.pose, r.velocity, r.acceleration) for r in self.made]
        return tuple(np.array(column) for column in zip(*columns, strict=True))

    def distance(self) -> tuple[np.ndarray, np.ndarray]:
        """Times and the largest distance to the cue at each, m or rad."""
        t, p, *_ = self.arrays()
        return t, np.max(np.abs(p - self.pose(t)), axis=1)


@given(
    hz=st.floats(0.5, 9.0),
    share=st.floats(0.05, 0.97),
    seed=st.integers(0, 1000),
    client_starts_s=st.sampled_from([0.0, 1.7e9]),
)
@settings(max_examples=15, deadline=None)
def test_a_cue_inside_all_limits_passes_untouched(hz, share, seed, client_starts_s):
    play = Play(after_a_rest(multisine(hz, share, seed)), client_starts_s=client_starts_s).run(7.0)
    assert not play.shaper.counts
    t, distance = play.distance()
    # A clock that counts from 1970 resolves a quarter of a microsecond.
    exact = 1e-9 if client_starts_s == 0.0 else 1e-7
    assert np.max(distance[t > 0.5 + RIG.cue.ramp_in]) < exact
    _, p, v, a = play.arrays()
    assert_within_limits(p, v, a)


def test_between_poses_that_are_20_ms_apart_a_cue_is_the_smooth_motion_through_them():
    play = Play(after_a_rest(multisine(6.5, 0.67, 3)), spacing_s=0.02).run(8.0)
    assert not play.shaper.counts
    t, distance = play.distance()
    settled = t > 0.5 + RIG.cue.ramp_in
    assert np.max(distance[settled]) < 5e-6
    assert np.max(distance[settled & (np.arange(len(t)) % 2 == 1)]) < 1e-9


@given(
    kind=st.sampled_from(["jump", "hop", "burst", "shake", "run"]),
    size=st.floats(0.01, 1.0),
    hz=st.floats(0.5, 7.0),
    share=st.floats(0.1, 0.9),
    seed=st.integers(0, 1000),
)
@settings(max_examples=15, deadline=None)
def test_after_any_upset_it_is_back_on_a_cue_inside_all_limits_and_stays(
    kind, size, hz, share, seed
):
    """Never swinging about it: back within three seconds, exactly, whatever happened for half a second."""
    calm = after_a_rest(multisine(hz, share, seed))
    from_s = QUIET_S + 2.5

    def upset(t: np.ndarray) -> np.ndarray:
        during = (t >= from_s) & (t < from_s + 0.5)
        shapes = {
            "jump": 0.06 * size * (t >= from_s),
            "hop": 0.15 * size * during,
            "burst": 0.02 * size * np.sin(2.0 * np.pi * 12.0 * t) * during,
            "shake": 1e-3 * size * np.sin(1e7 * np.round(t * 1e3)) * during,
            "run": 0.4 * size * (t - from_s) * during,
        }
        return 0.75 * calm(t) + shapes[kind][:, None] * np.array([0.5, 1.0, -1.0])

    play = Play(upset).run(from_s + 4.5)
    t, distance = play.distance()
    assert np.max(distance[t > from_s + 3.5]) < 1e-9
    _, p, v, a = play.arrays()
    assert_within_limits(p, v, a)


@given(data=st.data(), seed=st.integers(0, 10_000))
@settings(max_examples=25, deadline=None)
def test_whatever_the_cue_does_the_motion_keeps_all_limits_and_can_always_end(data, seed):
    """Waves, noise, jumps, reversals far beyond every limit, late and jittering; and then an end."""
    rng = np.random.default_rng(seed)
    size = data.draw(st.sampled_from([1e-5, 1e-3, 0.05, 0.5]))
    fast = multisine(data.draw(st.floats(0.5, 20.0)), data.draw(st.floats(0.2, 5.0)), seed)
    noise = size * rng.normal(size=(2000, 3)) * data.draw(st.sampled_from([0.0, 1.0]))
    steps = rng.choice([-0.3, 0.0, 0.3], size=(40, 3)) * data.draw(st.sampled_from([0.0, 1.0]))
    late = rng.exponential(data.draw(st.sampled_from([0.0, 0.004, 0.03])), size=2000)

    def pose(t: np.ndarray) -> np.ndarray:
        k = np.round(t / DT).astype(int)
        return fast(t) + noise[k] + steps[k // 50]

    play = Play(pose, delay_s=lambda k: float(late[k])).run(data.draw(st.floats(2.5, 6.0)))
    end = data.draw(st.sampled_from(["hold", "park"]))
    getattr(play.shaper, end)()
    play.sending = False
    play.run(1.0 if end == "hold" else 8.0)
    _, p, v, a = play.arrays()
    assert_within_limits(p, v, a)
    assert play.shaper.at_rest
    assert end == "hold" or play.shaper.at_parked


@pytest.mark.parametrize("name", ["stewart", "simona", "axis"])
def test_other_rigs_pass_a_cue_inside_their_limits_too(name):
    rig = load_rig(name)
    n = len(rig.limits)
    velocity, acceleration, _ = (np.array(x) for x in rig.cue_limits())
    w = 2.0 * np.pi * 2.5
    amplitude = 0.3 * np.minimum(velocity / w, acceleration / w**2)

    def pose(t: np.ndarray) -> np.ndarray:
        u = np.clip((t - rig.cue.ramp_in - 1.0) / 2.0, 0.0, 1.0)[:, None]
        fade = u**4 * (35.0 - 84.0 * u + 70.0 * u**2 - 20.0 * u**3)
        return fade * amplitude * np.sin(w * t[:, None] + np.arange(n))

    assert rig.bus.cycle == DT
    play = Play(pose, rig=rig).run(rig.cue.ramp_in + 4.0)
    t, distance = play.distance()
    assert not play.shaper.counts
    assert np.max(distance[t > 0.5 + rig.cue.ramp_in]) < 1e-9
