"""What enters a frequency response: a signal of a run at its own instants, or a pose from all actuators.

Every sample stands at the instant at which its value held: a drive's answer at its receipt less
`bus.answer_delay`, the IMU's at its stamp less `imu.delay`, a cue when asked for. A setpoint stands where
the drive's own reference shall reach it: one cycle after its slot where the drive draws a line, half a
cycle where it holds, another cycle where it plays setpoints on its own clock, and `bus.setpoint_delay`.
Its slot is its place in the daemon's schedule, for which it was reckoned: frames leave late by jitter.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from hil.config import RigFile
from hil.control.track import MERGE_S
from hil.errors import IdentificationError
from hil.identify.frequency.harmonics import harmonic_amplitudes, sample_step, waveform
from hil.rigs import Manipulator, build_rig
from hil.runs import Run
from hil.units import quantity_unit

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

GRID_PER_LINE: Final = 4
"""Instants a line of the grid on which poses are reckoned: twice what the highest line needs."""
EARLIEST: Final = 0.01
"""Share of frames that may seem to leave before their slot."""


class Channel(Protocol):
    """One input or output of a frequency response."""

    @property
    def name(self) -> str:
        """As the command line calls it."""

    @property
    def unit(self) -> str:
        """SI."""

    @property
    def rate_hz(self) -> float:
        """Samples a second; of several signals the slowest's."""

    @property
    def span_s(self) -> tuple[float, float]:
        """First and last instant at which it is known."""

    def amplitudes(self, start_s: float, period_s: float, count: int) -> ComplexArray:
        """Complex amplitudes (count + 1,) of mean and harmonics over the period from `start_s`."""

    def at(self, t_s: Array) -> Array:
        """Values between the samples, by cubic splines: what non-periodic data must make do with."""


@dataclass(frozen=True, slots=True)
class Sampled:
    """A signal as it was sampled."""

    name: str
    unit: str
    t_s: Array
    value: Array

    @property
    def rate_hz(self) -> float:
        """Samples a second."""
        return 1.0 / sample_step(self.t_s)

    @property
    def span_s(self) -> tuple[float, float]:
        """First and last sample."""
        return float(self.t_s[0]), float(self.t_s[-1])

    def amplitudes(self, start_s: float, period_s: float, count: int) -> ComplexArray:
        """By least squares on the true instants."""
        return harmonic_amplitudes(self.t_s, self.value, start_s, period_s, count, self.name)

    def at(self, t_s: Array) -> Array:
        """By a cubic spline through the samples."""
        return np.asarray(CubicSpline(self.t_s, self.value)(t_s))


@dataclass(frozen=True, slots=True)
class Posed:
    """A coordinate of the pose that closes the mechanism over the actuators' positions.

    No two actuators are sampled at one instant. A periodic position is known at every instant by its
    harmonics, so the pose is exact there; otherwise splines must serve.
    """

    name: str
    unit: str
    parts: tuple[Sampled, ...]
    manipulator: Manipulator
    index: int

    @property
    def rate_hz(self) -> float:
        """Of the actuator that is sampled least often."""
        return min(part.rate_hz for part in self.parts)

    @property
    def span_s(self) -> tuple[float, float]:
        """Where all actuators are known."""
        spans = [part.span_s for part in self.parts]
        return max(a for a, _ in spans), min(b for _, b in spans)

    def amplitudes(self, start_s: float, period_s: float, count: int) -> ComplexArray:
        """Harmonics of each actuator, positions of all on one grid, poses, harmonics of the pose."""
        size = GRID_PER_LINE * (count + 1)
        rho = [waveform(p.amplitudes(start_s, period_s, count), size) for p in self.parts]
        spectrum = np.fft.rfft(self._poses(np.column_stack(rho))) / size
        spectrum[1:] *= 2.0
        return np.asarray(spectrum[: count + 1])

    def at(self, t_s: Array) -> Array:
        """By splines through the actuators' positions."""
        return self._poses(np.column_stack([p.at(t_s) for p in self.parts]))

    def _poses(self, rho: Array) -> Array:
        pose, guess = np.empty(len(rho)), None
        for k, row in enumerate(rho):
            guess = self.manipulator.forward(row, guess)
            pose[k] = guess[self.index]
        return pose


def channel(run: Run, rig: RigFile, name: str) -> Channel:
    """The channel `name` of a run.

    `cue.heave`, `leg1.position`, `leg1.setpoint`, `imu.accel_z`: as the run has them. `heave` (or
    another coordinate): the pose by forward kinematics of the measured positions. `setpoint.heave`: the
    same of the setpoints. IdentificationError names what the run lacks.
    """
    if name in rig.coordinates:
        return _posed(run, rig, name, "position", name)
    if name.startswith("setpoint.") and name.removeprefix("setpoint.") in rig.coordinates:
        return _posed(run, rig, name, "setpoint", name.removeprefix("setpoint."))
    return _sampled(run, rig, name)


def _posed(run: Run, rig: RigFile, name: str, quantity: str, coordinate: str) -> Posed:
    parts = tuple(_sampled(run, rig, f"{a}.{quantity}") for a in rig.actuator_names)
    index = rig.coordinates.index(coordinate)
    return Posed(name, _coordinate_unit(rig, coordinate), parts, build_rig(rig), index)


def _sampled(run: Run, rig: RigFile, name: str) -> Sampled:
    if name not in run.table.columns or name == "t":
        there = ", ".join([*rig.coordinates, *(c for c in run.table.columns if c != "t")])
        raise IdentificationError(f"{run.path.name}: has no signal {name!r}; there are {there}")
    value = run.table[name].to_numpy()
    known = ~np.isnan(value)
    t = run.table["t"].to_numpy()
    # A cue's pose and the next cue's first, meant for one instant, differ by rounding: the later counts.
    known[np.flatnonzero(known)[:-1][np.diff(t[known]) < MERGE_S]] = False
    t = t[known]
    if len(t) < 4:
        raise IdentificationError(f"{run.path.name}: {name} has {len(t)} samples, too few")
    if name.endswith(".setpoint"):
        t = _slots(t, rig.bus.cycle)
    return Sampled(name, _unit(rig, name), t + shift_s(rig, name), value[known])


def _slots(t_s: Array, cycle_s: float) -> Array:
    """The schedule behind send instants: a grid of cycles under the earliest of them."""
    phase = t_s - t_s[0] - cycle_s * np.round((t_s - t_s[0]) / cycle_s)
    first = t_s[0] + float(np.quantile(phase, EARLIEST))
    return np.asarray(first + cycle_s * np.round((t_s - first) / cycle_s))


def shift_s(rig: RigFile, name: str) -> float:
    """From the stamp in the table to the instant at which the value held, s."""
    group, _, quantity = name.partition(".")
    bus = rig.bus
    if group == "imu":
        return -rig.imu.delay if rig.imu else 0.0
    if group == "cue":
        return 0.0
    if quantity == "force_setpoint":
        return bus.setpoint_delay
    if quantity == "setpoint":
        waits_s = bus.waits_s(rig.actuator_names.index(group))
        return bus.setpoint_delay + waits_s + bus.reach_s
    return -bus.answer_delay


def _unit(rig: RigFile, name: str) -> str:
    group, _, quantity = name.partition(".")
    if group == "cue":
        return _coordinate_unit(rig, quantity)
    return quantity_unit(quantity, is_rotary=rig.is_rotary)


def _coordinate_unit(rig: RigFile, coordinate: str) -> str:
    return "rad" if rig.rotates(coordinate) else "m"
