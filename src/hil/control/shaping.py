"""Turns accepted cues into a motion the rig can follow: limited in pose, speed, acceleration and jerk.

Each cycle the shaper steps from its own last state, never from measured values, towards the cue, the
parked pose or rest. Every state it emits has a quickest stop that keeps all limits, coordinates' and
actuators'; where no better step is safe, that stop is what it does.
"""

from __future__ import annotations

from collections import Counter
from typing import Final, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from ruckig import Trajectory

from hil.config import RigFile
from hil.control.actuator_limits import ActuatorLimits, Demand
from hil.control.planner import CoordinatePlanner, State
from hil.control.reference import Reference
from hil.control.track import CueTrack
from hil.errors import LimitViolation
from hil.rigs import Manipulator
from hil.signals import Cue

Vector = NDArray[np.float64]
Mode = Literal["hold", "follow", "park"]

FOLLOW_S: Final = 0.05
FOLLOW_CYCLES: Final = 5
"""Errors to a cue that is known ahead close within this time or so many cycles: poles near 70 rad/s."""
FOLLOW_GUESSED: Final = 4.0
FOLLOW_MOST_S: Final = 0.15
"""Where the newest pose lies in the past the target is a guess that each new cue corrects: following
is gentler by so many times its age, or the rig would shake with the rate of the cues."""
GUESS_SMOOTH_S: Final = 1.0
EASE_AT: Final = 0.97
"""From this use of an actuator's limit on, the speed share is lowered."""
SLOWEST: Final = 0.02
RECOVERY_PER_S: Final = 0.5
REST_VELOCITY: Final = 1.0e-5
REST_ACCELERATION: Final = 1.0e-3
PARKED: Final = 1.0e-5


class CueShaper:
    """Shapes the cues of one rig. `counts` tells how many cycles each rule held motion back."""

    def __init__(self, rig: RigFile, manipulator: Manipulator) -> None:
        velocity, acceleration, jerk = (np.asarray(x) for x in rig.cue_limits())
        self._coordinates = rig.coordinates
        self._actuators = ActuatorLimits(rig, manipulator)
        self.acceleration_share = self._actuators.acceleration_share(rig.limits, acceleration)
        """Share of cue.acceleration in use: below 1 where an actuator's acceleration_max forbids more."""
        self._cycle_s = rig.bus.cycle
        self._guessed_s = 0.0
        self._limits = np.asarray(rig.limits)
        self._jerk = jerk
        self._planners = [
            CoordinatePlanner(v, self.acceleration_share * a, j, limit, rig.bus.cycle)
            for v, a, j, limit in zip(velocity, acceleration, jerk, rig.limits, strict=True)
        ]
        self._track = CueTrack(velocity, rig.cue.future)
        self._stale_s = rig.cue.stale
        self._ramp_s = rig.cue.ramp_in
        self._parked = np.asarray(rig.parked_pose)
        self._park_share = rig.parking.speed_share
        self._gain_goal = rig.cue.gain
        self._gain = (rig.cue.gain, 0.0, 0.0)
        self._mode: Mode = "hold"
        self._speed_share = 1.0
        self._share = 1.0
        self._outside = 0.0
        self._client: str | None = None
        self._last_cue_s = -np.inf
        self._ramp_from = self._parked
        self._ramp_start_s: float | None = None
        self._states = [State(float(p), 0.0, 0.0) for p in self._parked]
        self.counts: Counter[str] = Counter()

    @property
    def mode(self) -> Mode:
        """What the shaper is doing."""
        return self._mode

    @property
    def gain(self) -> float:
        """The master gain in force at this moment, 0..1."""
        return self._gain[0]

    @property
    def pose(self) -> Vector:
        """The pose last asked for (n,)."""
        return np.array([s.p for s in self._states])

    @property
    def at_rest(self) -> bool:
        """True where the motion asked for has come to rest."""
        return all(abs(s.v) < REST_VELOCITY and abs(s.a) < REST_ACCELERATION for s in self._states)

    @property
    def at_parked(self) -> bool:
        """True where it rests in the parked pose."""
        return self.at_rest and bool(np.all(np.abs(self.pose - self._parked) < PARKED))

    def reset(self, pose: Vector) -> None:
        """Start from rest at `pose` (n,), where the rig stands. LimitViolation if it is not finite."""
        if not np.all(np.isfinite(pose)):
            raise LimitViolation(
                f"the rig's pose {pose} is not finite: motion cannot start from it"
            )
        self._states = [State(float(p), 0.0, 0.0) for p in pose]
        self._outside = self._actuators.outside(np.asarray(pose, dtype=np.float64))
        self._speed_share = 1.0
        self._gain = (self._gain_goal, 0.0, 0.0)
        self.hold()

    def set_gain(self, gain: float) -> None:
        """Set the master gain, reached smoothly within about cue.ramp_in; LimitViolation outside 0..1."""
        if not 0.0 <= gain <= 1.0:
            raise LimitViolation(f"gain {gain} lies outside 0..1: a gain can only lower motion")
        self._gain_goal = gain

    def accept(self, cue: Cue) -> None:
        """Take a cue that CueGuard let through. A new or resuming client starts with a soft ramp."""
        if cue.client != self._client or cue.received_s - self._last_cue_s > self._stale_s:
            self._track.clear()
            self._ramp_start_s = None
        self._client = cue.client
        self._last_cue_s = cue.received_s
        self._track.add(cue)

    def follow(self) -> None:
        """Follow cues from now on, beginning with a soft ramp from where the motion stands."""
        self._mode = "follow"
        self._ramp_start_s = None

    def hold(self) -> None:
        """Come to rest as quickly as limits allow, and stay."""
        self._mode = "hold"

    def park(self, speed_share: float | None = None) -> None:
        """Go to the parked pose with `speed_share` of speed and acceleration; default: the rig file's."""
        share = self._park_share if speed_share is None else speed_share
        if not 0.0 < share <= 1.0:
            raise LimitViolation(f"parking speed share {share} lies outside 0..1")
        self._share = share
        self._mode = "park"

    def step(self, now_s: float) -> Reference:
        """The motion wanted one bus cycle after `now_s`. Call once a cycle."""
        self._advance_gain()
        limited: list[str] = []
        goals = self._goals(now_s)
        plans = self._plan(goals, self._speed_share, limited)
        demand = self._demand(plans)
        if demand.use > 1.0:
            limited.append(demand.rule)
        if demand.use > EASE_AT:
            self._speed_share = max(self._speed_share * max(0.5, EASE_AT / demand.use), SLOWEST)
        elif demand.use < 0.9:
            faster = self._speed_share + RECOVERY_PER_S * self._cycle_s
            self._speed_share = min(faster, 1.0)
        if demand.use > 1.0:
            plans = self._plan(goals, self._speed_share, [])
            if self._demand(plans).use > 1.0:
                plans = [_stop(pl, s) for pl, s in zip(self._planners, self._states, strict=True)]
        self._states = [state for state, _ in plans]
        self.counts.update(limited)
        pose = self.pose
        self._outside = self._actuators.outside(pose)
        return Reference(
            now_s + self._cycle_s,
            pose,
            np.array([s.v for s in self._states]),
            np.array([s.a for s in self._states]),
            tuple(limited),
        )

    def _advance_gain(self) -> None:
        """Three equal real poles: smooth up to the acceleration, no overshoot, there within ramp_in."""
        g, gd, gdd = self._gain
        w, dt = 8.0 / self._ramp_s, self._cycle_s
        gdd -= dt * w * (3.0 * gdd + w * (3.0 * gd + w * (g - self._gain_goal)))
        gd += dt * gdd
        self._gain = (min(max(g + dt * gd, 0.0), 1.0), gd, gdd)

    def _target(self, now_s: float, t_s: float) -> tuple[Vector, Vector, Vector]:
        """The cue at `t_s`, by master gain and ramp, inside the workspace."""
        p, v, a = self._track.target(t_s)
        g, gd, gdd = self._gain
        p, v, a = g * p, g * v + gd * p, g * a + 2.0 * gd * v + gdd * p
        if self._ramp_start_s is None:
            self._ramp_start_s = now_s
            self._ramp_from = self.pose
        u = (t_s - self._ramp_start_s) / self._ramp_s
        if u < 1.0:
            w = u**3 * (10.0 - 15.0 * u + 6.0 * u * u)
            wd = 30.0 * u * u * (1.0 - u) ** 2 / self._ramp_s
            wdd = 60.0 * u * (1.0 - u) * (1.0 - 2.0 * u) / self._ramp_s**2
            d = p - self._ramp_from
            p, v, a = self._ramp_from + w * d, w * v + wd * d, w * a + 2.0 * wd * v + wdd * d
        inside = np.clip(p, -self._limits, self._limits)
        beyond = inside != p
        return inside, np.where(beyond, 0.0, v), np.where(beyond, 0.0, a)

    def _goals(self, now_s: float) -> _Goals | None:
        """Where to go from here: None is to rest."""
        if self._mode == "park":
            return _Goals(None, self._parked, np.zeros_like(self._parked), self._share)
        if self._mode == "hold" or not len(self._track):
            return None
        age = min(max(now_s - self._track.newest_s, 0.0), self._stale_s)
        self._guessed_s += (age - self._guessed_s) * self._cycle_s / GUESS_SMOOTH_S
        pose, velocity, _ = self._target(now_s, now_s + self._cycle_s)
        return _Goals(self._met(now_s), pose, velocity, 1.0)

    def _met(self, now_s: float) -> tuple[Vector, Vector, Vector]:
        """The target's state in which to meet it: the cue's own where it reaches so far ahead.

        Else the present one, carried on with its acceleration: no lag behind constant acceleration.
        """
        t = self._within_s
        if now_s + t <= self._track.newest_s:
            return self._target(now_s, now_s + t)
        p, v, a = self._target(now_s, now_s)
        return p + t * (v + 0.5 * t * a), v + t * a, a

    @property
    def _within_s(self) -> float:
        quickest = max(FOLLOW_S, FOLLOW_CYCLES * self._cycle_s)
        return min(quickest + FOLLOW_GUESSED * self._guessed_s, max(FOLLOW_MOST_S, quickest))

    def _plan(self, goals: _Goals | None, speed_share: float, limited: list[str]) -> list[_Plan]:
        """Next state of each coordinate with its quickest stop; coordinates' own limits kept."""
        plans: list[_Plan] = []
        for k, (planner, s) in enumerate(zip(self._planners, self._states, strict=True)):
            if goals is None:
                plans.append(_stop(planner, s))
                continue
            if goals.met is not None:
                end = State(*(float(x[k]) for x in goals.met))
                step = planner.follow(s, end, self._within_s, speed_share)
                stop = None if step is None else planner.stopping(step)
                if step is not None and stop is not None:
                    plans.append((step, stop))
                    continue
                limited.append(f"cue_limits:{self._coordinates[k]}")
            near = State(float(goals.pose[k]), float(goals.velocity[k]), 0.0)
            step = planner.hurry(s, near, speed_share * goals.share, goals.share)
            stop = None if step is None else planner.stopping(step)
            if step is not None and stop is not None:
                plans.append((step, stop))
            else:
                limited.append(f"workspace:{self._coordinates[k]}")
                plans.append(_stop(planner, s))
        return plans

    def _demand(self, plans: list[_Plan]) -> Demand:
        """The actuators' limit most used by the next state and by the quickest stop from it.

        Taking an acceleration back to zero at the jerk limit j adds a²/2j to the speed first.
        """
        q, qd, qdd = (np.array(x) for x in zip(*(state for state, _ in plans), strict=True))
        faster = np.where(qd * qdd > 0.0, qdd * qdd / (2.0 * self._jerk), 0.0)
        ends = [
            state.p if stop is None else stop.at_time(stop.duration)[0][0] for state, stop in plans
        ]
        return max(
            self._actuators.demand(q, qd, qdd, faster),
            self._actuators.stroke_demand(np.array(ends), self._outside),
        )


_Plan = tuple[State, Trajectory | None]


class _Goals(NamedTuple):
    """Targets of one cycle: `met` to follow smoothly, else pose and velocity to reach quickly."""

    met: tuple[Vector, Vector, Vector] | None
    pose: Vector
    velocity: Vector
    share: float


def _stop(planner: CoordinatePlanner, s: State) -> _Plan:
    """First cycle of the quickest stop. Ruckig finds one from any finite state; else stand still."""
    step = planner.stop(s)
    return (State(s.p, 0.0, 0.0), None) if step is None else (step, planner.stopping(step))
