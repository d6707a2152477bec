"""Poses of a hexapod over time, commanded, measured and simulated, on common instants."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from hil.config import RigFile
from hil.config.rig import ROTATIONS
from hil.identify.estimate import TwinProblem
from hil.identify.frequency.channels import Sampled, channel
from hil.identify.replay import stretches
from hil.rigs import build_rig
from hil.ui.reproduce.bench import Played
from hil.ui.reproduce.curves import COMMANDED, MEASURED, SIMULATED, Curve, Panel
from hil.ui.reproduce.report import Table

Array = NDArray[np.float64]
Series = tuple[Array, Array]
STEP_S: Final = 0.02
DELAY: Final = "bus.setpoint_delay"


@dataclass(frozen=True, slots=True)
class Motions:
    """One motion three ways: poses (N, n) at t_s (N,), s from the motion's first row."""

    coordinates: tuple[str, ...]
    t_s: Array
    commanded: Array
    measured: Array
    simulated: Array

    def shown(self, k: int) -> tuple[float, str]:
        """(factor, unit) in which coordinate k is shown: what moves little in µm and 10⁻³ degrees."""
        is_angle = self.coordinates[k] in ROTATIONS
        largest = float(np.ptp(self.commanded[:, k]))
        if is_angle:
            return (np.degrees(1.0), "°") if largest > 1e-3 else (1e3 * np.degrees(1.0), "10⁻³ °")
        return (1e3, "mm") if largest > 1e-3 else (1e6, "µm")

    def panels(self) -> list[Panel]:
        """One panel a coordinate."""
        out = []
        for k, name in enumerate(self.coordinates):
            factor, unit = self.shown(k)
            curves = [
                Curve("measured", self.t_s, factor * self.measured[:, k], MEASURED),
                Curve("simulated", self.t_s, factor * self.simulated[:, k], SIMULATED),
                Curve("commanded", self.t_s, factor * self.commanded[:, k], COMMANDED, "dash"),
            ]
            out.append(Panel(name, "t, s", unit, curves))
        return out

    def table(self) -> Table:
        """How far commanded and simulated are from measured, RMS of each coordinate."""
        rows = []
        for k, name in enumerate(self.coordinates):
            factor, unit = self.shown(k)
            if unit == "mm":
                factor, unit = 1e6, "µm"
            elif unit == "°":
                factor, unit = 1e3 * factor, "10⁻³ °"
            size = factor * float(np.std(self.measured[:, k]))
            left = (factor * x for x in (self.rms(self.commanded)[k], self.rms(self.simulated)[k]))
            rows.append((f"{name}, {unit}", f"{size:.4g}", *(f"{x:.3g}" for x in left)))
        head = ("", "measured, spread", "commanded − measured, RMS", "simulated − measured, RMS")
        return Table(head, tuple(rows))

    def rms(self, poses: Array) -> Array:
        """(n,) root mean square of `poses` minus measured, m and rad."""
        return np.asarray(np.sqrt(np.mean((poses - self.measured) ** 2, axis=0)))


def motions_of(played: Played, model: RigFile) -> Motions:
    """The pose that drives were told, that they measured, and that the twin of `model` makes of it."""
    rig = played.job.rig
    measured = {a: _series(played, f"{a}.position") for a in rig.actuator_names}
    told = {a: _series(played, f"{a}.setpoint") for a in rig.actuator_names}
    simulated = replayed(played, model)
    parts = (*measured.values(), *told.values(), *simulated.values())
    start = max(played.start_s, *(t[0] for t, _ in parts))
    end = min(played.start_s + played.description.duration_s, *(t[-1] for t, _ in parts))
    t = np.arange(start, end, STEP_S)
    poses = (pose_of(rig, some, t) for some in (told, measured, simulated))
    return Motions(rig.coordinates, t - played.start_s, *poses)


def replayed(played: Played, model: RigFile) -> dict[str, Series]:
    """By actuator: positions that the twin of `model` answers, at the instants at which they held."""
    rig = played.job.rig
    piece = stretches(played.run)[0]
    # naming the delay makes the twin take it to the fraction of a tick, as the fits did
    problem = TwinProblem(model, [piece], ("mass.m", DELAY), ("position",))
    answers = problem.stretch_samples(problem.start)[0]
    return {
        a: (piece.samples[f"{a}.position"][0] - rig.bus.answer_delay, answers[f"{a}.position"])
        for a in rig.actuator_names
    }


def pose_of(rig: RigFile, positions: Mapping[str, Series], t_s: Array) -> Array:
    """Poses (N, n) at t_s of actuators that were sampled at their own instants."""
    manipulator = build_rig(rig)
    rho = np.column_stack([CubicSpline(*positions[a])(t_s) for a in rig.actuator_names])
    poses, guess = np.empty_like(rho), manipulator.neutral
    for k, row in enumerate(rho):
        guess = poses[k] = manipulator.forward(row, guess)
    return poses


def following_error(played: Played, actuator: str, delay_s: float) -> tuple[Array, Array, Array]:
    """(t, length, following error) of an actuator at its samples during the motion, s and m.

    The setpoint is the one that the drive is at, `delay_s` (as the twin found it) and its line behind the
    frame that brought it.
    """
    t, x = played.samples(f"{actuator}.position")
    told = CubicSpline(*_series(played, f"{actuator}.setpoint"))
    bus = played.job.rig.bus
    late_s = delay_s - bus.setpoint_delay + 0.5 * bus.position_loop
    return t - played.start_s, x, np.asarray(told(t - late_s) - x)


def _series(played: Played, name: str) -> Series:
    found = channel(played.run, played.job.rig, name)
    assert isinstance(found, Sampled)
    return found.t_s, found.value
