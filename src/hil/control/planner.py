"""One coordinate's next state under limits of velocity, acceleration and jerk.

Ways to a cue, gentlest first: along the cue itself, while what is left of an earlier distance to it dies
away; a minimum-jerk step that meets its state a little ahead; Ruckig's time-optimal plan for the distance
to a moving cue within what its motion leaves of the limits; Ruckig's time-optimal plan to where it is now.
Last, Ruckig's quickest stop. Whatever the way, a step is taken only if it is a motion within the limits
and the quickest stop from where it leads stays inside the workspace: a stop that does is always at hand.
"""

from __future__ import annotations

from typing import Final, NamedTuple

from ruckig import (
    ControlInterface,
    InputParameter,
    Ruckig,
    RuckigError,
    Trajectory,
)

ROUNDING: Final = 1.0e-9
LEAST_ROOM: Final = 0.05
"""Share of a limit that closing in on a cue may use where the cue leaves less."""


class State(NamedTuple):
    """Position, velocity, acceleration of one coordinate (m or rad, s)."""

    p: float
    v: float
    a: float

    def minus(self, other: State) -> State:
        """The motion relative to `other`."""
        return State(self.p - other.p, self.v - other.v, self.a - other.a)

    def plus(self, other: State) -> State:
        """Both motions together."""
        return State(self.p + other.p, self.v + other.v, self.a + other.a)


class Use(NamedTuple):
    """What a cue itself uses of the limits over the time it is looked ahead."""

    v_low: float
    v_high: float
    a_low: float
    a_high: float
    jerk: float


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
        self._distance = InputParameter(1)
        self._stop = InputParameter(1)
        self._stop.control_interface = ControlInterface.Velocity
        self._stop.target_velocity = [0.0]
        self._stop.max_acceleration = [acceleration]
        for each in (self._plan, self._stop):
            each.max_velocity = [velocity]
            each.max_jerk = [jerk]
        for each in (self._plan, self._distance, self._stop):
            each.target_acceleration = [0.0]
        self._trajectory = Trajectory(1)

    def pass_on(
        self, s: State, cue: State, after: State, within_s: float, use: Use, speed_share: float
    ) -> State | None:
        """The cue's own state `after` one cycle, with what is left of the distance to it; None over a limit.

        The distance closes along the minimum-jerk path that ends `within_s` from now, begun anew each
        cycle: poles near 3.7/T, and nothing at all is added to a cue on which the motion already is.
        That path must be able to end, too: taking turns with a quicker way that cannot, it would
        swing about the cue for ever.
        """
        off = s.minus(cue)
        t = within_s
        jerk = -60.0 * off.p / t**3 - 36.0 * off.v / t**2 - 9.0 * off.a / t
        last = -60.0 * off.p / t**3 - 24.0 * off.v / t**2 - 3.0 * off.a / t
        if not abs(last) <= max(self.jerk - use.jerk, LEAST_ROOM * self.jerk):
            return None
        step = after.plus(self._constant_jerk(off, jerk))
        return step if self._is_motion(s, step, speed_share) else None

    def meet(self, s: State, end: State, within_s: float, speed_share: float) -> State | None:
        """First cycle of the minimum-jerk path that is at `end` after `within_s`; None over a limit.

        The quintic between two states starts with jerk 60 Δp/T³ - (36 v0 + 24 v1)/T² + (3 a1 - 9 a0)/T
        and ends with the mirrored one, which must be possible too. What a cue shakes faster than in
        `within_s` it leaves out.
        """
        t = within_s
        jerk = (
            60.0 * (end.p - s.p) / t**3
            - (36.0 * s.v + 24.0 * end.v) / t**2
            + (3.0 * end.a - 9.0 * s.a) / t
        )
        last = (
            60.0 * (end.p - s.p) / t**3
            - (24.0 * s.v + 36.0 * end.v) / t**2
            + (9.0 * end.a - 3.0 * s.a) / t
        )
        if not abs(last) <= self.jerk:
            return None
        step = self._constant_jerk(s, jerk)
        return step if self._is_motion(s, step, speed_share) else None

    def catch_up(
        self, s: State, cue: State, after: State, use: Use, speed_share: float
    ) -> State | None:
        """First cycle of the quickest way onto a moving cue, within what it leaves of the limits.

        Time-optimal for the distance: a cue that keeps the limits with something to spare is reached,
        however fast it swings. None if none is found or the step breaks a limit after all.
        """
        off, plan = s.minus(cue), self._distance
        v, a = self.velocity * speed_share, self.acceleration
        plan.max_velocity = [max(v - use.v_high, LEAST_ROOM * v)]
        plan.min_velocity = [min(-v - use.v_low, -LEAST_ROOM * v)]
        plan.max_acceleration = [max(a - use.a_high, LEAST_ROOM * a)]
        plan.min_acceleration = [min(-a - use.a_low, -LEAST_ROOM * a)]
        plan.max_jerk = [max(self.jerk - use.jerk, LEAST_ROOM * self.jerk)]
        _begin(plan, off)
        plan.target_position, plan.target_velocity = [0.0], [0.0]
        closer = self._first_cycle(plan)
        if closer is None:
            return None
        step = after.plus(closer)
        return step if self._is_motion(s, step, speed_share) else None

    def hurry(
        self, s: State, target: State, speed_share: float, acceleration_share: float = 1.0
    ) -> State | None:
        """First cycle of the quickest path to position and velocity of `target`; None if none is found."""
        plan = self._plan
        v_max = self.velocity * speed_share
        plan.max_velocity = [v_max]
        plan.max_acceleration = [self.acceleration * acceleration_share]
        _begin(plan, s)
        plan.target_position = [target.p]
        plan.target_velocity = [min(max(target.v, -0.98 * v_max), 0.98 * v_max)]
        return self._first_cycle(plan)

    def stop(self, s: State) -> State | None:
        """First cycle of the quickest stop; None if Ruckig finds none."""
        _begin(self._stop, s)
        return self._first_cycle(self._stop)

    def stopping(self, step: State, s: State) -> Trajectory | None:
        """The whole quickest stop from `step`; None where it leaves the workspace.

        A motion that is outside at `s`, before the step, may stop nowhere further out.
        """
        _begin(self._stop, step)
        trajectory = Trajectory(1)
        try:
            if self._ruckig.calculate(self._stop, trajectory) < 0:
                return None
        except RuckigError:
            return None
        reach = trajectory.position_extrema[0]
        slack = 1.0e-9 * (1.0 + self.limit)
        low, high = min(-self.limit, s.p) - slack, max(self.limit, s.p) + slack
        return trajectory if low <= reach.min and reach.max <= high else None

    def _is_motion(self, s: State, after: State, speed_share: float) -> bool:
        """Whether some motion within all limits leads from `s` to `after` in a cycle; never with a NaN.

        Beside a constant jerk of the same mean, one within ±j bends velocity by up to j h²/4 and
        position by up to j h³/8. Taking the acceleration back to zero must not carry the velocity
        over its limit.
        """
        h, j = self._cycle_s, self.jerk
        v_mean = s.v + 0.5 * h * (s.a + after.a)
        p_mean = s.p + h * (s.v + h * (2.0 * s.a + after.a) / 6.0)
        peak = abs(after.v + 0.5 * after.a * abs(after.a) / j)
        return (
            abs(after.a - s.a) <= j * h * (1.0 + ROUNDING)
            and abs(after.a) <= self.acceleration * (1.0 + ROUNDING)
            and max(abs(after.v), peak) <= self.velocity * speed_share * (1.0 + ROUNDING)
            and abs(after.v - v_mean) <= 0.25 * j * h**2
            and abs(after.p - p_mean) <= 0.125 * j * h**3
        )

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


def _begin(plan: InputParameter, s: State) -> None:
    plan.current_position, plan.current_velocity = [s.p], [s.v]
    plan.current_acceleration = [s.a]
