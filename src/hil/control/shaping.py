"""Turns accepted cues into a motion the rig can follow: limited in pose, speed, acceleration and jerk.

Each cycle the shaper steps from its own last state, never from measured values, towards the cue, the
parked pose or rest. Every state it emits has a quickest stop that keeps all limits, coordinates' and
actuators'; where no better step is safe, that stop is what it does.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from typing import Final, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from ruckig import Trajectory

from hil.config import RigFile
from hil.control.actuator_limits import ActuatorLimits, Demand
from hil.control.planner import CoordinatePlanner, State
from hil.control.reference import Reference
from hil.control.wanted import CueGoal, Wanted
from hil.errors import LimitViolation
from hil.rigs import Manipulator
from hil.signals import Cue

Vector = NDArray[np.float64]
Mode = Literal["hold", "follow", "park"]

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
        self._jerk = jerk
        self._planners = [
            CoordinatePlanner(v, self.acceleration_share * a, j, limit, rig.bus.cycle)
            for v, a, j, limit in zip(velocity, acceleration, jerk, rig.limits, strict=True)
        ]
        self._parked = np.asarray(rig.parked_pose)
        self._wanted = Wanted(rig, self._parked)
        self._park_share = rig.parking.speed_share
        self._mode: Mode = "hold"
        self._speed_share = 1.0
        self._share = 1.0
        self._outside = 0.0
        self._states = [State(float(p), 0.0, 0.0) for p in self._parked]
        self.counts: Counter[str] = Counter()

    @property
    def mode(self) -> Mode:
        """What the shaper is doing."""
        return self._mode

    @property
    def gain(self) -> float:
        """The master gain in force at this moment, 0..1."""
        return self._wanted.gain

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
        self._wanted.settle_gain()
        self.hold()

    def set_gain(self, gain: float) -> None:
        """Set the master gain, reached smoothly within about cue.ramp_in; LimitViolation outside 0..1."""
        self._wanted.set_gain(gain)

    def accept(self, cue: Cue) -> None:
        """Take a cue that CueGuard let through. A new or resuming client starts with a soft ramp."""
        self._wanted.accept(cue)

    def follow(self) -> None:
        """Follow cues from now on, beginning with a soft ramp from where the motion stands."""
        self._mode = "follow"
        self._wanted.ramp_in()

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
        self._wanted.advance_gain()
        limited: list[str] = []
        goal = self._goal(now_s)
        plans = self._plan(goal, self._speed_share, limited)
        demand = self._demand(plans)
        if demand.use > 1.0:
            limited.append(demand.rule)
        if demand.use > EASE_AT:
            self._speed_share = max(self._speed_share * max(0.5, EASE_AT / demand.use), SLOWEST)
        elif demand.use < 0.9:
            faster = self._speed_share + RECOVERY_PER_S * self._cycle_s
            self._speed_share = min(faster, 1.0)
        if demand.use > 1.0:
            plans = self._plan(goal, self._speed_share, [])
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

    def _goal(self, now_s: float) -> CueGoal | _Park | None:
        """Where to go from here: None is to rest."""
        if self._mode == "park":
            return _Park(self._parked, self._share)
        if self._mode == "hold" or not self._wanted:
            return None
        return self._wanted.goal(now_s, self.pose)

    def _plan(
        self, goal: CueGoal | _Park | None, speed_share: float, limited: list[str]
    ) -> list[_Plan]:
        """Next state of each coordinate with its quickest stop; coordinates' own limits kept."""
        return [
            next(_ways(planner, s, goal, k, speed_share, self._coordinates[k], limited))
            for k, (planner, s) in enumerate(zip(self._planners, self._states, strict=True))
        ]

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


class _Park(NamedTuple):
    """A pose to come to rest in, with a share of speed and acceleration."""

    pose: Vector
    share: float


def _ways(
    planner: CoordinatePlanner,
    s: State,
    goal: CueGoal | _Park | None,
    k: int,
    speed_share: float,
    name: str,
    limited: list[str],
) -> Iterator[_Plan]:
    """Steps of coordinate k towards its goal from which it can stop, the gentlest first; last the stop.

    Notes in `limited` what kept the gentler ones from being taken.
    """
    if isinstance(goal, CueGoal):
        now, after, met = goal.now[k], goal.after[k], goal.met[k]
        use = None if goal.uses is None else goal.uses[k]
        if use is not None:
            step = planner.pass_on(s, now, after, goal.within_s, use, speed_share)
            yield from _stoppable(planner, s, step)
        yield from _stoppable(planner, s, planner.meet(s, met, goal.within_s, speed_share))
        limited.append(f"cue_limits:{name}")
        if use is not None:
            yield from _stoppable(planner, s, planner.catch_up(s, now, after, use, speed_share))
        yield from _stoppable(planner, s, planner.hurry(s, after, speed_share))
        limited.append(f"workspace:{name}")
    elif goal is not None:
        home = State(float(goal.pose[k]), 0.0, 0.0)
        step = planner.hurry(s, home, speed_share * goal.share, goal.share)
        yield from _stoppable(planner, s, step)
        limited.append(f"workspace:{name}")
    yield _stop(planner, s)


def _stoppable(planner: CoordinatePlanner, s: State, step: State | None) -> Iterator[_Plan]:
    stop = None if step is None else planner.stopping(step, s)
    if step is not None and stop is not None:
        yield step, stop


def _stop(planner: CoordinatePlanner, s: State) -> _Plan:
    """First cycle of the quickest stop. Ruckig finds one from any finite state; else stand still."""
    step = planner.stop(s)
    return (State(s.p, 0.0, 0.0), None) if step is None else (step, planner.stopping(step, s))
