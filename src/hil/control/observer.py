"""The rig's state now, from samples that are late, staggered and seldom.

Each actuator's filter (`hil.control.kalman`) stands at the instant of its last sample and is predicted
to now with the setpoints known to have reached the drive. Positions become the pose by the
manipulator's forward kinematics, velocities the rates by its Jacobian.
"""

from __future__ import annotations

import math
from collections import Counter
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hil.config import RigFile
from hil.control import kalman
from hil.control.friction import Friction
from hil.control.setpoints import Setpoints, clock_waits, slot_offsets
from hil.errors import KinematicsError
from hil.rigs import Manipulator
from hil.rigs.linear import solve_square
from hil.signals import Sample

Vector = NDArray[np.float64]

HISTORY: Final = 32
"""Setpoints remembered an actuator: at 10 ms more than the longest prediction."""
GATE: Final = 6.0
"""Standard deviations beyond which a sample is not believed."""
GATE_FLOOR: Final = 30.0
"""Never disbelieve a position nearer than this many times its noise: the model is not that good."""
MOST_REJECTED: Final = 3
"""So many samples in a row disbelieved: they are right and the filter is wrong."""
START_SPEED: Final = 0.1
START_ACCELERATION: Final = 2.0


class Observed(NamedTuple):
    """State of the rig at `t_s`; arrays (n,), SI. `is_known` once every actuator has a position."""

    t_s: float
    is_known: bool
    position: Vector
    velocity: Vector
    acceleration: Vector
    """Actuator space: m, m/s, m/s² (rad for rotary actuators)."""
    pose: Vector
    rates: Vector
    pose_acceleration: Vector
    """The same in the rig's coordinates."""
    unexplained: Vector
    """Acceleration of the pose that the model does not explain: what integral action acts on."""
    disturbance: Vector
    """The force at the actuators that would explain it, N or N·m."""
    force: Vector
    """Force last measured, NaN before."""
    age_s: Vector
    """Since each actuator's last position, inf before."""
    innovation: Vector
    """Of each actuator's last position, measured minus predicted."""


class Observer:
    """Observes one rig. `counts` tells what was rejected, dropped, restarted and where."""

    def __init__(self, rig: RigFile, manipulator: Manipulator) -> None:
        n = manipulator.n
        self._manipulator = manipulator
        self._friction = Friction(rig)
        self._index = {name: i for i, name in enumerate(rig.actuator_names)}
        self._offsets = slot_offsets(rig)
        self._cycle_s = rig.bus.cycle
        self._clock_waits = clock_waits(rig)
        self._drive_kinds = np.array(
            [kalman.PD if a.law == "pd" else kalman.POSITION for a in rig.actuators]
        )
        noise = rig.noise
        self._variance = {
            "position": position_variance(rig),
            "velocity": max(noise.velocity**2 + noise.velocity_step**2 / 12.0, 1.0e-10),
        }
        self._parameters = observer_parameters(rig)
        self._idle = np.full(n, kalman.IDLE)
        self._by_force = np.full(n, kalman.FORCE)
        self._kinds = self._idle  # one of three that nobody changes
        self._told = np.zeros((2, n, HISTORY))
        self._arrivals, self._values = self._told
        self._x = np.zeros((n, 3))
        self._P = np.zeros((n, 3, 3))
        # Each actuator's rows, made once: they are looked at with every sample.
        self._of = [
            (self._x[i], self._P[i], self._parameters[i], self._arrivals[i], self._values[i])
            for i in range(n)
        ]
        self._times = np.full(n, -math.inf)
        self._sampled = np.full(n, -math.inf)
        self._rejected = np.zeros(n, dtype=int)
        self._last_rejected = np.zeros((n, 2))
        self._force = np.full(n, math.nan)
        self._innovation = np.zeros(n)
        self._out = np.zeros((n, 4))
        self._pose: Vector = manipulator.neutral.copy()
        self.counts: Counter[str] = Counter()

    def sample(self, sample: Sample) -> None:
        """Take one sample of a drive; samples of other sources are ignored."""
        i = self._index.get(sample.source)
        if i is None:
            return
        if not math.isfinite(sample.value) or not math.isfinite(sample.sampled_s):
            self.counts[f"not_finite:{sample.source}"] += 1
        elif sample.quantity == "force":
            self._force[i] = sample.value
        elif sample.quantity in self._variance:
            self._take(i, sample)

    def applied(self, now_s: float, setpoints: Setpoints | None) -> None:
        """Tell what is sent in the cycle that starts at `now_s`; None where drives are off."""
        if setpoints is None:
            self._kinds = self._idle
            return
        arrivals = now_s + self._offsets
        if setpoints.kind == "force":
            kinds, values = self._by_force, self._respond(setpoints.values)
        else:
            kinds, values = self._drive_kinds, setpoints.values
            arrivals = arrivals + self._clock_waits
        if kinds is not self._kinds:
            for i in np.flatnonzero(kinds != self._kinds):
                self._arrivals[i] = arrivals[i]
                self._values[i] = values[i]
            self._kinds = kinds
        self._told[:, :, :-1] = self._told[:, :, 1:]
        self._arrivals[:, -1] = arrivals
        self._values[:, -1] = values

    def estimate(self, now_s: float) -> Observed:
        """State at `now_s` from all samples and setpoints told so far."""
        out = self._predict(now_s)
        rho, v, _, acceleration = out.T.copy()
        m = self._manipulator
        known = bool(np.all(np.isfinite(self._times)))
        zero: Vector = np.zeros(m.n)
        q: Vector = self._pose
        qd, qdd, unexplained, disturbance = zero, zero, zero, zero
        if known:
            try:
                q = m.forward(rho, self._pose)
                M, J = m.mass_and_jacobian(q)
                qd = _solve(J, v)
                qdd = _solve(J, acceleration - m.accelerations(q, qd, zero))
                unexplained = _solve(J, out[:, 2])
                disturbance = _solve(J.T, M @ unexplained)
                self._pose = q
            except (KinematicsError, np.linalg.LinAlgError):
                self.counts["closure"] += 1
        return Observed(
            t_s=now_s,
            is_known=known,
            position=rho,
            velocity=v,
            acceleration=acceleration,
            pose=q.copy(),
            rates=qd,
            pose_acceleration=qdd,
            unexplained=unexplained,
            disturbance=disturbance,
            force=self._force.copy(),
            age_s=now_s - self._sampled,
            innovation=self._innovation.copy(),
        )

    def _predict(self, now_s: float) -> NDArray[np.float64]:
        kalman.predict_all(
            self._x,
            self._times,
            now_s,
            self._kinds,
            self._parameters,
            self._arrivals,
            self._values,
            self._out,
        )
        return self._out

    def _respond(self, force: Vector) -> Vector:
        """Acceleration of each actuator that the model expects from the forces sent."""
        m = self._manipulator
        out = self._out
        q = self._pose
        try:
            qd = _solve(m.jacobian(q), out[:, 1])
            qdd = m.forward_dynamics(q, qd, force - self._friction.force(out[:, 1]))
            return m.accelerations(q, qd, qdd)
        except (KinematicsError, np.linalg.LinAlgError):
            self.counts["closure"] += 1
            return np.zeros(m.n)

    def _take(self, i: int, sample: Sample) -> None:
        row, sampled_s = 0 if sample.quantity == "position" else 1, sample.sampled_s
        t0 = self._times.item(i)
        if not math.isfinite(t0):
            if row == 0:
                self._start(i, sampled_s, sample.value, 0.0)
            return
        if sampled_s < t0 - 1.0e-9:
            self.counts[f"late:{sample.source}"] += 1
            return
        if sampled_s - t0 > kalman.LONGEST_S:
            self.counts[f"restarted:{sample.source}"] += 1
            if row == 0:
                self._start(i, sampled_s, sample.value, 0.0)
            return
        x, P, parameters, arrivals, values = self._of[i]
        kind = self._kinds[i]
        kalman.predict(x, P, t0, sampled_s, kind, parameters, arrivals, values, True)
        self._times[i] = sampled_s
        variance = self._variance[sample.quantity]
        floor = GATE_FLOOR * math.sqrt(variance)
        innovation, believed = kalman.correct(x, P, row, sample.value, variance, GATE, floor)
        if row == 0:
            self._innovation[i] = innovation
        if believed:
            self._rejected[i] = 0
            if row == 0:
                self._sampled[i] = sampled_s
        else:
            self._disbelieve(i, row, sample)

    def _disbelieve(self, i: int, row: int, sample: Sample) -> None:
        self.counts[f"rejected:{sample.source}"] += 1
        if row != 0:
            return
        before_t, before = self._last_rejected[i]
        self._last_rejected[i] = sample.sampled_s, sample.value
        self._rejected[i] += 1
        if self._rejected[i] >= MOST_REJECTED:
            self.counts[f"restarted:{sample.source}"] += 1
            dt = sample.sampled_s - before_t
            speed = (sample.value - before) / dt if dt > 0.0 else 0.0
            limit = self._parameters[i, kalman.V_MAX]
            self._start(i, sample.sampled_s, sample.value, min(max(speed, -limit), limit))

    def _start(self, i: int, t_s: float, position: float, velocity: float) -> None:
        self._x[i] = position, velocity, 0.0
        self._P[i] = np.diag([self._variance["position"], START_SPEED**2, START_ACCELERATION**2])
        self._times[i] = self._sampled[i] = t_s
        self._rejected[i] = 0


def _solve(matrix: Vector, right: Vector) -> Vector:
    # Five solves a cycle: compiled they cost a tenth of numpy's.
    spent, solution = matrix.copy(), right.copy()
    if not solve_square(spent, solution):
        raise np.linalg.LinAlgError("singular matrix")
    return solution


def observer_parameters(rig: RigFile) -> NDArray[np.float64]:
    """Parameter rows (n, 7) of the filters, by `hil.control.kalman`'s columns.

    The random walk's intensity makes the filter's poles those of a third-order Butterworth filter at
    control.observer: for a triple integrator measured with variance R every T, ω⁶ = q / (R T).
    """
    period = sample_cycles(rig) * rig.bus.cycle
    rows = np.zeros((len(rig.actuators), kalman.PARAMETERS))
    for row, a in zip(rows, rig.actuators, strict=True):
        pd = a.law == "pd"
        row[kalman.K_P] = a.position_gain / a.effective_mass if pd else a.position_gain
        row[kalman.K_D] = a.speed_gain / a.effective_mass
        row[kalman.LAG] = a.effective_mass / max(a.speed_gain, 1.0e-3 * a.effective_mass)
        row[kalman.V_MAX] = a.velocity_max
        row[kalman.K_FV] = 1.0 if rig.control.precontrol else a.velocity_ff
        row[kalman.RAMP] = rig.bus.cycle if rig.bus.interpolation != "hold" else 0.0
        row[kalman.NOISE] = rig.control.observer**6 * position_variance(rig) * period
    return rows


def position_variance(rig: RigFile) -> float:
    """Variance of a position sample, noise and quantisation, m² or rad²; never quite zero."""
    return max(rig.noise.position**2 + rig.noise.position_step**2 / 12.0, 1.0e-14)


def sample_cycles(rig: RigFile) -> int:
    """Cycles from one position of a drive to its next; 0 would never come, so it counts as one turn."""
    if rig.bus.schedule == "fast":
        return 1
    asked = rig.bus.pattern.count("position")
    return -(-len(rig.bus.pattern) // max(asked, 1))
