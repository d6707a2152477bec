"""A whole cue trajectory as values: resampled, filtered, checked against a rig's limits, scaled to fit.

Nothing here clips. Where a trajectory asks for more than the rig has, `check` says where and by how
much, and `fit` scales whole coordinates and says by which factor.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator
from scipy.signal import butter, sosfiltfilt

from hil.config import RigFile
from hil.control.actuator_limits import ActuatorLimits
from hil.errors import RunError
from hil.rigs import Manipulator

Array = NDArray[np.float64]

RESERVE: Final = 0.98
"""Fitted trajectories use so much of a limit: shaping and its interpolation need a little room."""
SHRINK: Final = 0.97
UNIFORM: Final = 1.0e-3
"""Spread of time steps, relative, up to which a trajectory counts as uniformly sampled."""


@dataclass(frozen=True, slots=True)
class CueTrajectory:
    """Poses (m, n) at times t_s (m,), in the order of `coordinates` (n); m or rad.

    RunError where shapes do not match, a value is not finite or time does not increase: names the row.
    """

    coordinates: tuple[str, ...]
    t_s: Array
    poses: Array

    def __post_init__(self) -> None:
        if self.poses.shape != (len(self.t_s), len(self.coordinates)) or len(self.t_s) < 2:
            raise RunError(
                f"a cue trajectory needs two rows or more of time and {list(self.coordinates)}, got "
                f"{len(self.t_s)} times and poses of shape {self.poses.shape}"
            )
        bad = ~(np.isfinite(self.t_s) & np.isfinite(self.poses).all(axis=1))
        if bad.any():
            raise RunError(f"cue trajectory, row {int(np.argmax(bad))}: a value is not finite")
        back = np.flatnonzero(np.diff(self.t_s) <= 0.0)
        if len(back):
            raise RunError(
                f"cue trajectory, row {back[0] + 1}: time {self.t_s[back[0] + 1]} s does not increase"
            )

    @property
    def duration_s(self) -> float:
        """From first to last row, s."""
        return float(self.t_s[-1] - self.t_s[0])

    @property
    def step_s(self) -> float:
        """Mean time step, s."""
        return self.duration_s / (len(self.t_s) - 1)

    def derivatives(self) -> tuple[Array, Array, Array]:
        """Velocity, acceleration, jerk (m, n) by central differences of a uniform trajectory."""
        self._need_uniform("derivatives")
        velocity = np.gradient(self.poses, self.step_s, axis=0)
        acceleration = np.gradient(velocity, self.step_s, axis=0)
        return velocity, acceleration, np.gradient(acceleration, self.step_s, axis=0)

    def resampled(self, rate_hz: float) -> CueTrajectory:
        """At a uniform rate, by monotone cubics: no overshoot between the rows."""
        count = int(np.floor(self.duration_s * rate_hz + 1.0e-9)) + 1
        if count < 2:
            raise RunError(
                f"{self.duration_s:g} s of trajectory hold no two samples at {rate_hz:g} Hz"
            )
        t = self.t_s[0] + np.arange(count) / rate_hz
        poses = PchipInterpolator(self.t_s, self.poses, axis=0)(np.minimum(t, self.t_s[-1]))
        return replace(self, t_s=t, poses=poses)

    def low_passed(self, cutoff_hz: float) -> CueTrajectory:
        """Filtered forwards and backwards (Butterworth, order 2 twice): no delay at any frequency."""
        self._need_uniform("the zero-phase filter")
        nyquist = 0.5 / self.step_s
        if not 0.0 < cutoff_hz < nyquist:
            raise RunError(
                f"cut-off {cutoff_hz:g} Hz lies outside 0..{nyquist:g} Hz of a trajectory sampled "
                f"at {2 * nyquist:g} Hz"
            )
        sections = butter(2, cutoff_hz, fs=2.0 * nyquist, output="sos")
        padding = min(len(self.t_s) - 1, int(3.0 / (cutoff_hz * self.step_s)))
        try:
            poses = sosfiltfilt(sections, self.poses, axis=0, padlen=padding)
        except np.linalg.LinAlgError as error:
            raise RunError(f"cut-off {cutoff_hz:g} Hz is too low to be reckoned with") from error
        return replace(self, poses=poses)

    def scaled(self, factors: Array) -> CueTrajectory:
        """Each coordinate by its factor (n,)."""
        return replace(self, poses=self.poses * factors)

    def _need_uniform(self, what: str) -> None:
        steps = np.diff(self.t_s)
        if np.ptp(steps) > UNIFORM * np.mean(steps):
            raise RunError(f"{what}: rows are not evenly spaced in time; resample first")


@dataclass(frozen=True, slots=True)
class Violation:
    """One stretch of time in which a limit is broken, told by its worst instant."""

    rule: str
    """workspace, velocity, acceleration, jerk, or an actuator's: stroke, actuator_speed, closure ..."""
    name: str
    """The coordinate, or the actuator."""
    t_s: float
    value: float
    bound: float

    def __str__(self) -> str:
        return f"{self.rule} of {self.name} at {self.t_s:.3f} s: {self.value:.4g}, bound {self.bound:.4g}"


@dataclass(frozen=True, slots=True)
class Fitted:
    """A trajectory that keeps a rig's limits, and what was done to it."""

    trajectory: CueTrajectory
    factors: tuple[float, ...]
    cutoff_hz: float | None
    notes: tuple[str, ...]


def check(
    trajectory: CueTrajectory, rig: RigFile, manipulator: Manipulator
) -> tuple[Violation, ...]:
    """Every stretch that breaks a limit of the rig file; a uniform trajectory in the rig's coordinates."""
    _need_coordinates(trajectory, rig)
    found: list[Violation] = []
    for rule, values, bounds in _uses(trajectory, rig):
        for k, name in enumerate(trajectory.coordinates):
            for stretch in _stretches(np.abs(values[:, k]) > bounds[k] * (1.0 + 1.0e-9)):
                i = stretch.start + int(np.argmax(np.abs(values[stretch, k])))
                t_s = float(trajectory.t_s[i])
                found.append(Violation(rule, name, t_s, float(values[i, k]), float(bounds[k])))
    return (*found, *_check_actuators(trajectory, rig, manipulator))


def fit(
    trajectory: CueTrajectory,
    rig: RigFile,
    manipulator: Manipulator,
    cutoff_hz: float | None = None,
) -> Fitted:
    """Low-pass (where asked), then scale each coordinate down until every limit is kept."""
    _need_coordinates(trajectory, rig)
    notes: list[str] = []
    fitted = trajectory
    if cutoff_hz is not None:
        fitted = fitted.low_passed(cutoff_hz)
        lost = np.max(np.abs(fitted.poses - trajectory.poses), axis=0)
        notes += [
            f"{name}: low-passed at {cutoff_hz:g} Hz, which changed it by up to {x:.3g}"
            for name, x in zip(trajectory.coordinates, lost, strict=True)
        ]
    factors = np.ones(len(rig.coordinates))
    reasons = [""] * len(factors)
    for rule, values, bounds in _uses(fitted, rig):
        peaks = np.max(np.abs(values), axis=0)
        for k in np.flatnonzero(peaks * factors > RESERVE * bounds):
            factors[k] = RESERVE * bounds[k] / peaks[k]
            reasons[k] = f"its {rule} peaked at {peaks[k]:.3g}, bound {bounds[k]:.3g}"
    while broken := _check_actuators(fitted.scaled(factors), rig, manipulator):
        worst = max(broken, key=lambda violation: violation.value)
        # Speeds and accelerations shrink with the factors; strokes and closure only say too far.
        in_proportion = worst.rule in ("actuator_speed", "actuator_acceleration")
        factors *= RESERVE / worst.value if in_proportion else SHRINK
        reasons = [str(worst)] * len(factors)
    notes += [
        f"{name}: scaled by {factor:.3f}: {reason}"
        for name, factor, reason in zip(rig.coordinates, factors, reasons, strict=True)
        if reason
    ]
    return Fitted(fitted.scaled(factors), tuple(factors.tolist()), cutoff_hz, tuple(notes))


def _uses(trajectory: CueTrajectory, rig: RigFile) -> list[tuple[str, Array, Array]]:
    """Of each rule its name, values and bounds; velocity from row to row, as the guard of cues has it."""
    _, acceleration, jerk = trajectory.derivatives()
    velocity = np.diff(trajectory.poses, axis=0) / trajectory.step_s
    bounds = [np.asarray(x) for x in (rig.limits, *rig.cue_limits())]
    values = (trajectory.poses, velocity, acceleration, jerk)
    rules = ("workspace", "velocity", "acceleration", "jerk")
    return list(zip(rules, values, bounds, strict=True))


def _check_actuators(
    trajectory: CueTrajectory, rig: RigFile, manipulator: Manipulator
) -> list[Violation]:
    """Actuators' limits, where the poses themselves lie inside the workspace."""
    limits = ActuatorLimits(rig, manipulator)
    velocity, acceleration, _ = trajectory.derivatives()
    demands = [
        max(limits.demand(*state), limits.stroke_demand(state[0]))
        for state in zip(trajectory.poses, velocity, acceleration, strict=True)
    ]
    use = np.array([d.use for d in demands])
    found = []
    for stretch in _stretches(use > 1.0):
        i = stretch.start + int(np.argmax(use[stretch]))
        rule, name = demands[i].rule.split(":")
        found.append(Violation(rule, name, float(trajectory.t_s[i]), float(use[i]), 1.0))
    return found


def _stretches(mask: NDArray[np.bool_]) -> list[slice]:
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(int)))
    return [slice(a, b) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def _need_coordinates(trajectory: CueTrajectory, rig: RigFile) -> None:
    if trajectory.coordinates != rig.coordinates:
        raise RunError(
            f"the trajectory has coordinates {list(trajectory.coordinates)}, the rig {rig.name} "
            f"needs {list(rig.coordinates)}"
        )
