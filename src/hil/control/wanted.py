"""What the client wants at an instant: its cues by master gain and soft ramp, inside the workspace."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hil.config import RigFile
from hil.control.planner import State, Use
from hil.control.setpoints import within
from hil.control.track import CueTrack
from hil.errors import LimitViolation
from hil.signals import Cue

Vector = NDArray[np.float64]

FOLLOW_S: Final = 0.05
FOLLOW_CYCLES: Final = 5
"""Distances to a cue that is known ahead close within this time or so many cycles: poles near 70 rad/s."""
FOLLOW_GUESSED: Final = 4.0
FOLLOW_MOST_S: Final = 0.15
"""Where the newest pose lies in the past the target is a guess that each new cue corrects: following
is gentler by so many times its age, or the rig would shake with the rate of the cues."""
GUESS_SMOOTH_S: Final = 1.0


class CueGoal(NamedTuple):
    """A cue at the instants that one cycle's plan needs, for each coordinate."""

    now: list[State]
    after: list[State]
    """One cycle later."""
    met: list[State]
    """After `within_s`: the cue's own state, or the present one carried on with its acceleration."""
    within_s: float
    uses: list[Use] | None
    """Of the limits until then; None where the cue does not reach so far ahead."""


class Wanted:
    """The cues of one rig's client, softened."""

    def __init__(self, rig: RigFile, start: Vector) -> None:
        self._track = CueTrack(np.asarray(rig.cue_limits()[0]), rig.cue.future)
        self._limits = np.asarray(rig.limits)
        self._cycle_s = rig.bus.cycle
        self._stale_s = rig.cue.stale
        self._ramp_s = rig.cue.ramp_in
        self._gain_goal = rig.cue.gain
        self._gain = (rig.cue.gain, 0.0, 0.0)
        self._guessed_s = 0.0
        self._client: str | None = None
        self._last_cue_s = -np.inf
        self._ramp_from = start
        self._ramp_start_s: float | None = None

    def __bool__(self) -> bool:
        return len(self._track) > 0

    @property
    def gain(self) -> float:
        """The master gain in force at this moment, 0..1."""
        return self._gain[0]

    @property
    def within_s(self) -> float:
        """Time in which a distance to the cue shall close."""
        quickest = max(FOLLOW_S, FOLLOW_CYCLES * self._cycle_s)
        return min(quickest + FOLLOW_GUESSED * self._guessed_s, max(FOLLOW_MOST_S, quickest))

    def set_gain(self, gain: float) -> None:
        """Set the master gain, reached smoothly within about cue.ramp_in; LimitViolation outside 0..1."""
        if not 0.0 <= gain <= 1.0:
            raise LimitViolation(f"gain {gain} lies outside 0..1: a gain can only lower motion")
        self._gain_goal = gain

    def settle_gain(self) -> None:
        """Nothing moves: the master gain is at once what it was set to."""
        self._gain = (self._gain_goal, 0.0, 0.0)

    def accept(self, cue: Cue) -> None:
        """Take a cue that CueGuard let through. A new or resuming client starts with a soft ramp."""
        if cue.client != self._client or cue.received_s - self._last_cue_s > self._stale_s:
            self._track.clear()
            self.ramp_in()
        self._client = cue.client
        self._last_cue_s = cue.received_s
        self._track.add(cue)

    def ramp_in(self) -> None:
        """Begin softly from where the motion stands when it is next asked for."""
        self._ramp_start_s = None

    def advance_gain(self) -> None:
        """Three equal real poles: smooth up to the acceleration, no overshoot, there within ramp_in."""
        g, gd, gdd = self._gain
        w, dt = 8.0 / self._ramp_s, self._cycle_s
        gdd -= dt * w * (3.0 * gdd + w * (3.0 * gd + w * (g - self._gain_goal)))
        gd += dt * gdd
        self._gain = (min(max(g + dt * gd, 0.0), 1.0), gd, gdd)

    def goal(self, now_s: float, pose: Vector) -> CueGoal:
        """Where to go in the cycle that begins at `now_s` with the motion at `pose` (n,). Needs a cue."""
        if self._ramp_start_s is None:
            self._ramp_start_s, self._ramp_from = now_s, pose
        age = min(max(now_s - self._track.newest_s, 0.0), self._stale_s)
        self._guessed_s += (age - self._guessed_s) * self._cycle_s / GUESS_SMOOTH_S
        within_s = self.within_s
        if now_s + within_s > self._track.newest_s:
            now, after = self._at(now_s, now_s, now_s + self._cycle_s)
            p, v, a = now
            met = np.array([p + within_s * (v + 0.5 * within_s * a), v + within_s * a, a])
            return CueGoal(_states(now), _states(after), _states(met), within_s, None)
        ahead_s = (0.0, self._cycle_s, 0.5 * within_s, within_s)
        motion = self._at(now_s, *(now_s + s for s in ahead_s))
        now, after, _, met = motion
        return CueGoal(_states(now), _states(after), _states(met), within_s, _uses(ahead_s, motion))

    def _at(self, now_s: float, *times_s: float) -> Vector:
        """The cue by master gain and ramp, inside the workspace: position and two rates (times, 3, n)."""
        motion = self._track.targets(times_s)
        p, v, a = motion.swapaxes(0, 1)
        g0, gd0, gdd = self._gain
        ahead_s = np.array(times_s)[:, None] - now_s
        g, gd = g0 + ahead_s * gd0, gd0 + ahead_s * gdd
        p, v, a = g * p, g * v + gd * p, g * a + 2.0 * gd * v + gdd * p
        for k, t_s in enumerate(times_s):
            u = (t_s - (self._ramp_start_s or 0.0)) / self._ramp_s
            if u < 1.0:
                p[k], v[k], a[k] = self._ramped(u, p[k], v[k], a[k])
        inside = within(p, self._limits)
        beyond = inside != p
        motion[:, 0] = inside
        motion[:, 1] = np.where(beyond, 0.0, v)
        motion[:, 2] = np.where(beyond, 0.0, a)
        return motion

    def _ramped(self, u: float, p: Vector, v: Vector, a: Vector) -> tuple[Vector, Vector, Vector]:
        """A motion (n,) after the share u of the soft ramp's time."""
        w = u**3 * (10.0 - 15.0 * u + 6.0 * u * u)
        wd = 30.0 * u * u * (1.0 - u) ** 2 / self._ramp_s
        wdd = 60.0 * u * (1.0 - u) * (1.0 - 2.0 * u) / self._ramp_s**2
        d = p - self._ramp_from
        return self._ramp_from + w * d, w * v + wd * d, w * a + 2.0 * wd * v + wdd * d


def _states(motion: Vector) -> list[State]:
    return [State(*column) for column in motion.T.tolist()]


def _uses(ahead_s: tuple[float, ...], motion: Vector) -> list[Use]:
    """Extremes of a motion (instants, 3, n) at increasing times: what it needs of the limits."""
    order = np.argsort(ahead_s)
    motion, times = motion[order], np.array(ahead_s)[order]
    v, a = motion[:, 1], motion[:, 2]
    least, most = np.minimum.reduce, np.maximum.reduce  # what min() and max() do, at a third of it
    jerk = most(np.abs(a[1:] - a[:-1]) / (times[1:] - times[:-1])[:, None])
    extremes = np.array([least(v), most(v), least(a), most(a), jerk])
    return [Use(*column) for column in extremes.T.tolist()]
