"""What a report says of a run: signals, poses, errors, states and timing, in a person's units.

Errors are setpoint minus measured at the instant at which the measured value held, so a drive's lag
stays in them. Angles are shown in degrees, lengths in mm.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt
import pandas as pd

from hil.config import RigFile
from hil.config.bicycle import SIGNALS
from hil.errors import KinematicsError
from hil.rigs import Manipulator, build_rig
from hil.runs import Run
from hil.units import quantity_unit

Array = npt.NDArray[np.float64]

MOST_POSES: Final = 40_000
"""Forward kinematics of so many instants at most (about 0.1 ms each); longer runs are thinned."""

HOLE: Final = 20.0
"""A step of so many usual ones holds no samples, as of forces at rest, which are not judged."""


@dataclass(frozen=True, slots=True)
class Series:
    """Values over time, NaN-free; `unit` as shown."""

    t: Array
    values: Array
    unit: str = ""

    def scaled(self, factor: float, unit: str) -> Series:
        """The same in another unit."""
        return Series(self.t, self.values * factor, unit)

    def at(self, t: Array) -> Array:
        """Linear between samples, NaN outside."""
        if not len(self.t):
            return np.full(len(t), np.nan)
        return np.interp(t, self.t, self.values, left=np.nan, right=np.nan)


EMPTY: Final = Series(np.empty(0), np.empty(0))


@dataclass(frozen=True, slots=True)
class Quantity:
    """Cue, setpoint and measured value of one coordinate or actuator, and the error of tracking."""

    name: str
    unit: str
    cue: Series
    setpoint: Series
    measured: Series
    error: Series
    """setpoint - measured."""


@dataclass(frozen=True, slots=True)
class Stay:
    """The rig was in `state` from `start_s` to `end_s`."""

    state: str
    start_s: float
    end_s: float


@dataclass(frozen=True, slots=True)
class RunView:
    """A run made ready to be shown."""

    run: Run
    coordinates: tuple[Quantity, ...]
    actuators: tuple[Quantity, ...]
    forces: dict[str, Series]
    told: dict[str, Series]
    """What a bicycle measures of itself."""
    imu: dict[str, Series]
    stays: tuple[Stay, ...]
    lateness_us: Array


def view(run: Run) -> RunView:
    """Everything that report and summary show of `run`."""
    rig = run.rig
    names = rig.actuator_names if rig else _actuators_of(run.table)
    delay = rig.bus.answer_delay if rig else 0.0
    positions = {a: _delayed(signal(run.table, f"{a}.position"), delay) for a in names}
    setpoints = {a: signal(run.table, f"{a}.setpoint") for a in names}
    coordinates: tuple[Quantity, ...] = ()
    if rig is not None:
        manipulator = build_rig(rig)
        asked = _pose_setpoints(run, rig, manipulator, setpoints)
        setpoints = _actuator_setpoints(setpoints, asked, manipulator, rig)
        measured = _poses(manipulator, positions)
        coordinates = tuple(
            _quantity(c, _unit(rig, c), signal(run.table, f"cue.{c}"), asked[c], measured[c])
            for c in rig.coordinates
        )
    rotary = rig is not None and rig.is_rotary
    actuators = tuple(
        _quantity(a, "°" if rotary else "mm", EMPTY, setpoints[a], positions[a]) for a in names
    )
    imu = {c: signal(run.table, str(c)) for c in run.table.columns if str(c).startswith("imu.")}
    return RunView(
        run,
        coordinates,
        actuators,
        {a: _force(run, rig, a) for a in names},
        _told(run),
        imu,
        _stays(run.states),
        _lateness_us(run.states),
    )


def _told(run: Run) -> dict[str, Series]:
    turns = np.degrees(1.0)
    angles = {name: signal(run.table, name) for name in SIGNALS}
    return {n: s if n == "rear_wheel" else s.scaled(turns, "°") for n, s in angles.items()}


def signal(table: pd.DataFrame, name: str) -> Series:
    """The samples of one column; empty where the run has no such column."""
    if name not in table.columns:
        return EMPTY
    values = table[name].to_numpy(dtype=float)
    there = ~np.isnan(values)
    return Series(table["t"].to_numpy(dtype=float)[there], values[there])


def thinned(series: Series, most: int) -> Series:
    """At most `most` samples that look the same: lowest and highest of each stretch are kept."""
    n = len(series.t)
    if n <= most:
        return series
    size = -(-n // (most // 2 - 1))
    whole = n // size * size
    blocks = series.values[:whole].reshape(-1, size)
    start = np.arange(len(blocks)) * size
    picks = np.sort(np.stack([start + blocks.argmin(1), start + blocks.argmax(1)], 1), axis=1)
    index = np.unique(np.concatenate([picks.ravel(), [0, n - 1]]))
    return Series(series.t[index], series.values[index], series.unit)


def drawn(series: Series, most: int) -> tuple[Array, Array]:
    """`thinned`, with a NaN in each hole of the samples: a line across it would be of none of them."""
    steps = np.diff(series.t)
    is_hole = steps > HOLE * np.median(steps) if len(steps) else steps > 0.0
    middle = series.t[:-1][is_hole] + 0.5 * steps[is_hole]
    few = thinned(series, most)
    at = np.searchsorted(few.t, middle)
    return np.insert(few.t, at, middle), np.insert(few.values, at, np.nan)


def _quantity(name: str, unit: str, cue: Series, setpoint: Series, measured: Series) -> Quantity:
    factor = np.degrees(1.0) if unit == "°" else 1000.0
    error = setpoint.at(measured.t) - measured.values
    there = ~np.isnan(error)
    return Quantity(
        name,
        unit,
        cue.scaled(factor, unit),
        setpoint.scaled(factor, unit),
        measured.scaled(factor, unit),
        Series(measured.t[there], error[there] * factor, unit),
    )


def _unit(rig: RigFile, coordinate: str) -> str:
    return "°" if rig.rotates(coordinate) else "mm"


def _actuators_of(table: pd.DataFrame) -> tuple[str, ...]:
    return tuple(
        str(c).removesuffix(".position") for c in table.columns if str(c).endswith(".position")
    )


def _delayed(series: Series, delay_s: float) -> Series:
    """Stamped by receipt, held `delay_s` before."""
    return Series(series.t - delay_s, series.values)


def _pose_setpoints(
    run: Run, rig: RigFile, manipulator: Manipulator, setpoints: dict[str, Series]
) -> dict[str, Series]:
    """From the state messages; in a run without them, from the actuators' setpoints."""
    if all(f"setpoint.{c}" in run.states.columns for c in rig.coordinates):
        return {c: signal(run.states, f"setpoint.{c}") for c in rig.coordinates}
    return _poses(manipulator, setpoints)


def _actuator_setpoints(
    sent: dict[str, Series], asked: dict[str, Series], manipulator: Manipulator, rig: RigFile
) -> dict[str, Series]:
    """As sent to the drives; where they were sent forces, those of the pose that was asked for."""
    if any(len(s.t) for s in sent.values()):
        return sent
    t = asked[rig.coordinates[0]].t
    if not len(t):
        return sent
    poses = np.stack([asked[c].at(t) for c in rig.coordinates], axis=1)
    rho = np.stack([manipulator.inverse(q) for q in poses])
    return {a: Series(t, rho[:, i]) for i, a in enumerate(rig.actuator_names)}


def _poses(manipulator: Manipulator, lengths: dict[str, Series]) -> dict[str, Series]:
    """Poses by forward kinematics, at the first actuator's instants."""
    first = lengths[manipulator.actuators[0]]
    step = max(1, -(-len(first.t) // MOST_POSES))
    rho = np.stack([lengths[a].at(first.t[::step]) for a in manipulator.actuators], axis=1)
    there = ~np.isnan(rho).any(axis=1)
    t, rho = first.t[::step][there], rho[there]
    poses = np.full(rho.shape, np.nan)
    guess = manipulator.neutral
    for k, row in enumerate(rho):
        try:
            guess = poses[k] = manipulator.forward(row, guess)
        except KinematicsError:
            guess = manipulator.neutral
    closed = ~np.isnan(poses).any(axis=1)
    return {c: Series(t[closed], poses[closed, i]) for i, c in enumerate(manipulator.coordinates)}


def _force(run: Run, rig: RigFile | None, actuator: str) -> Series:
    unit = quantity_unit("force", is_rotary=rig is not None and rig.is_rotary)
    return signal(run.table, f"{actuator}.force").scaled(1.0, unit)


def _stays(states: pd.DataFrame) -> tuple[Stay, ...]:
    if "state" not in states.columns or states.empty:
        return ()
    names = states["state"].tolist()
    t = states["t"].to_numpy()
    starts = [0, *(k for k in range(1, len(names)) if names[k] != names[k - 1])]
    ends = [*starts[1:], len(names) - 1]
    return tuple(
        Stay(str(names[a]), float(t[a]), float(t[b])) for a, b in zip(starts, ends, strict=True)
    )


def _lateness_us(states: pd.DataFrame) -> Array:
    if "lateness_s" not in states.columns:
        return np.empty(0)
    return 1e6 * states["lateness_s"].to_numpy(dtype=float)
