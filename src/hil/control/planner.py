"""One coordinate's next state under limits of velocity, acceleration and jerk.

Three ways, gentlest first: a minimum-jerk step that follows a moving target without lag and without
the bang-bang of time-optimal plans; Ruckig's time-optimal plan where the first would break a limit;
Ruckig's quickest stop. A step is taken only if the quickest stop from where it leads stays inside the
workspace, so a stop that does is always at hand.
"""

from __future__ import annotations

from typing import NamedTuple

from ruckig import (
    ControlInterface,
    InputParameter,
    Ruckig,
    RuckigError,
    Trajectory,
)


class State(NamedTuple):
    """Position, velocity, acceleration of one coordinate (m or rad, s)."""

    p: float
    v: float
    a: float


class CoordinatePlanner:
    """Plans one coordinate cycle by cycle; limits in m or rad and seconds."""

    def __init__(
        self, velocity: float, acceleration: float, jerk: float, limit: float, cycle_s: float
    ) -> None:
        self.velocity = velocity
        self.acceleration = acceleration
        self.jerk = jerk
        self.limit = limit
        self._cycle_s = cycle_s
        self._ruckig = Ruckig(1)
        self._plan = InputParameter(1)
        self._stop = InputParameter(1)
        self._stop.control_interface = ControlInterface.Velocity
        self._stop.target_velocity = [0.0]
        self._stop.max_acceleration = [acceleration]
        for each in (self._plan, self._stop):
            each.max_velocity = [velocity]
            each.max_jerk = [jerk]
            each.target_acceleration = [0.0]
        self._trajectory = Trajectory(1)

    def follow(self, s: State, end: State, within_s: float, speed_share: float) -> State | None:
        """First cycle of the minimum-jerk path that is at `end` after `within_s`; None over a limit.

        The quintic between two states starts with jerk 60 Δp/T³ - (36 v0 + 24 v1)/T² + (3 a1 - 9 a0)/T:
        poles near 3.7/T whatever the end does, and no lag behind a motion whose end is known. It ends
        with the mirrored one, which must be possible too: a path that cannot brake at its end would
        overshoot, and taking turns with `hurry` it would swing about the target for ever.
        """
        t = within_s
        jerk = (
            60.0 * (end.p - s.p) / t**3
            - (36.0 * s.v + 24.0 * end.v) / t**2
            + (3.0 * end.a - 9.0 * s.a) / t
        )
        last_jerk = (
            60.0 * (end.p - s.p) / t**3
            - (24.0 * s.v + 36.0 * end.v) / t**2
            + (9.0 * end.a - 3.0 * s.a) / t
        )
        after = self._constant_jerk(s, jerk)
        # Taking the acceleration back to zero must not carry the velocity over its limit.
        peak = abs(after.v + 0.5 * after.a * abs(after.a) / self.jerk)
        if (
            max(abs(jerk), abs(last_jerk)) <= self.jerk
            and abs(after.a) <= self.acceleration
            and max(abs(after.v), peak) <= self.velocity * speed_share
        ):
            return after
        return None

    def hurry(
        self, s: State, target: State, speed_share: float, acceleration_share: float = 1.0
    ) -> State | None:
        """First cycle of the quickest path to position and velocity of `target`; None if none is found."""
        plan = self._plan
        v_max = self.velocity * speed_share
        plan.max_velocity = [v_max]
        plan.max_acceleration = [self.acceleration * acceleration_share]
        plan.current_position, plan.current_velocity = [s.p], [s.v]
        plan.current_acceleration = [s.a]
        plan.target_position = [target.p]
        plan.target_velocity = [min(max(target.v, -0.98 * v_max), 0.98 * v_max)]
        return self._first_cycle(plan)

    def stop(self, s: State) -> State | None:
        """First cycle of the quickest stop; None if Ruckig finds none."""
        self._set_stop(s)
        return self._first_cycle(self._stop)

    def stopping(self, s: State) -> Trajectory | None:
        """The whole quickest stop from `s`; None where it leaves the workspace (or leaves it further)."""
        self._set_stop(s)
        trajectory = Trajectory(1)
        try:
            if self._ruckig.calculate(self._stop, trajectory) < 0:
                return None
        except RuckigError:
            return None
        reach = trajectory.position_extrema[0]
        slack = 1.0e-9 * (1.0 + self.limit)
        high = max(self.limit, s.p) if s.v <= 0.0 else self.limit
        low = min(-self.limit, s.p) if s.v >= 0.0 else -self.limit
        return trajectory if low - slack <= reach.min and reach.max <= high + slack else None

    def _set_stop(self, s: State) -> None:
        self._stop.current_position, self._stop.current_velocity = [s.p], [s.v]
        self._stop.current_acceleration = [s.a]

    def _first_cycle(self, plan: InputParameter) -> State | None:
        try:
            if self._ruckig.calculate(plan, self._trajectory) < 0:
                return None
            p, v, a = self._trajectory.at_time(self._cycle_s)
        except RuckigError:
            return None
        return State(p[0], v[0], a[0])

    def _constant_jerk(self, s: State, jerk: float) -> State:
        t = self._cycle_s
        return State(
            s.p + t * (s.v + t * (0.5 * s.a + t * jerk / 6.0)),
            s.v + t * (s.a + 0.5 * t * jerk),
            s.a + t * jerk,
        )
