"""Turns a foreign log (CSV, also compressed, or parquet) into a cue trajectory by a `CueMap`.

What is done: unit and scale, a uniform rate, the low-pass that the map asks for, then the pose itself
or its washout. What is not: limits. `hil.control.trajectory.fit` brings the result inside those of
the rig and says how.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np
import numpy.typing as npt

from hil.config import RigFile
from hil.control.trajectory import UNIFORM, CueTrajectory
from hil.control.washout import Washout, WashoutSettings
from hil.errors import RunError
from hil.runs.cuemap import TIME_UNITS, Channel, CueMap
from hil.runs.importing.clocks import GAP
from hil.runs.importing.tables import TableSource, read_csv, read_parquet
from hil.runs.table import check_increasing

Array = npt.NDArray[np.float64]

_TILTED_BY: Final = {"pitch": 0, "surge": 0, "roll": 1, "sway": 1, "heave": 2}
"""Axis (x forward, y left, z up) of the acceleration that moves a coordinate."""
_TURNED_BY: Final = {"roll": 0, "pitch": 1, "yaw": 2}

SPEED_LOW_PASS_HZ: Final = 1.0
"""A speed is smoothed so before it is differentiated, unless its channel says otherwise: wheel
sensors step, and a step of speed is a spike of acceleration."""

LONGEST_GAP_S: Final = 60.0
"""Rows further apart are two rides, or a clock that was set meanwhile."""
SLOWEST_S: Final = 2.0
QUICKEST_S: Final = 5e-5
"""Rows further apart or nearer are no ride: their time is in another unit. A GPS has one a second."""


@dataclass(frozen=True, slots=True)
class ImportedCue:
    """A trajectory made of a log, and a line for each thing that was done to it."""

    trajectory: CueTrajectory
    notes: tuple[str, ...]


def cue_from_log(
    path: Path, cue_map: CueMap, rig: RigFile, rate_hz: float | None = None
) -> ImportedCue:
    """The log at `path` as a trajectory of `rig`'s coordinates, from t = 0 on.

    `rate_hz`: sampling rate of a log without a time column, before the map's own. Raises RunError
    where the log cannot be read or does not hold what the map names: file, column and row.
    """
    for c in cue_map.channel:
        if c.coordinate not in rig.coordinates:
            raise RunError(
                f"the map moves {c.coordinate!r}, but the rig {rig.name!r} has only "
                f"{', '.join(rig.coordinates)}"
            )
    log = _read(path, cue_map)
    t = _time(log, cue_map, path, rate_hz)
    notes = [f"from {path.name}, SHA-256 {hashlib.sha256(path.read_bytes()).hexdigest()}"]
    notes += _gaps(t)
    parts: list[CueTrajectory] = []
    for c in cue_map.channel:
        source = CueTrajectory((c.column,), t, _column(log, c.column, path)[:, None] * c.factor)
        try:
            moved, what = _moved(_even(source), c)
        except RunError as error:
            time = cue_map.time
            hint = f"; is its time, {time.column}, really in {time.unit}?" if time else ""
            raise RunError(f"{path}: column {c.column}: {error}{hint}") from error
        parts.append(moved)
        notes.append(f"{c.coordinate}: {c.column} in {c.unit} times {c.scale:g}, {what}")
    poses = np.zeros((len(parts[0].t_s), len(rig.coordinates)))
    for c, part in zip(cue_map.channel, parts, strict=True):
        poses[:, rig.coordinates.index(c.coordinate)] += part.poses[:, 0]
    still = [c for c in rig.coordinates if c not in {m.coordinate for m in cue_map.channel}]
    if still:
        notes.append(f"{', '.join(still)}: not in the map, kept at 0")
    return ImportedCue(CueTrajectory(rig.coordinates, parts[0].t_s, poses), tuple(notes))


def _read(path: Path, cue_map: CueMap) -> TableSource:
    if not path.is_file():
        raise RunError(f"{path}: no such file")
    wanted = {c.column for c in cue_map.channel}
    if cue_map.time is not None:
        wanted.add(cue_map.time.column)
    if path.suffix == ".parquet":
        return read_parquet(path, wanted)
    return read_csv(path, wanted, cue_map.file)


def _time(log: TableSource, cue_map: CueMap, path: Path, rate_hz: float | None) -> Array:
    """Seconds from the first row on."""
    if cue_map.time is not None:
        t = _column(log, cue_map.time.column, path) * TIME_UNITS[cue_map.time.unit]
        check_increasing(t, f"{path}: column {cue_map.time.column}", "row", strictly=True)
        _check_time(t, f"{path}: column {cue_map.time.column}", cue_map.time.unit)
        return np.asarray(t - t[0])
    rate = rate_hz or cue_map.rate_hz
    if rate is None:
        raise RunError(
            f"{path}: say when its rows were taken: a time column (t=COLUMN:s in the map) or a rate"
        )
    if not QUICKEST_S <= 1.0 / rate <= SLOWEST_S:
        raise RunError(
            f"{path}: a row each {1.0 / rate:.3g} s is no ride: is its rate {rate:g} Hz?"
        )
    return np.arange(len(_column(log, cue_map.channel[0].column, path))) / rate


def _check_time(t: Array, where: str, unit: str) -> None:
    """RunError where the rows are so far apart, or so near, that the unit of time must be another.

    So it is where a single step is no pause any more.
    """
    steps = np.diff(t)
    step = float(np.median(steps))
    if not QUICKEST_S <= step <= SLOWEST_S:
        other = "ms or finer" if step > SLOWEST_S else "coarser"
        raise RunError(
            f"{where}: a row each {step:.3g} s is no ride: the map says {unit}, is its unit {other}?"
        )
    worst = int(np.argmax(steps))
    if steps[worst] > LONGEST_GAP_S:
        raise RunError(
            f"{where}: {steps[worst]:.4g} s without a row after row {worst + 1}: two rides, or a clock that "
            "was set meanwhile? cut the log there"
        )


def _gaps(t: Array) -> list[str]:
    """A note where rows are missing."""
    steps = np.diff(t)
    gaps = np.flatnonzero(steps > GAP * np.median(steps))
    if not gaps.size:
        return []
    worst = int(gaps[np.argmax(steps[gaps])])
    return [
        f"{gaps.size} gaps, the longest {steps[worst]:.3g} s after row {worst + 1}: nobody measured what "
        "stands there"
    ]


def _column(log: TableSource, name: str, path: Path) -> Array:
    values = log.column(name).values
    empty = np.flatnonzero(np.isnan(values))
    if empty.size:
        raise RunError(f"{path}: column {name}, row {int(empty[0]) + 1}: is empty")
    if len(values) < 2:
        raise RunError(f"{path}: has {len(values)} rows, that is no ride")
    return values


def _even(trajectory: CueTrajectory) -> CueTrajectory:
    """Evenly spaced: filters and washout step at a fixed interval."""
    steps = np.diff(trajectory.t_s)
    if np.ptp(steps) <= UNIFORM * np.mean(steps):
        return trajectory
    return trajectory.resampled(float(1.0 / np.median(steps)))


def _moved(source: CueTrajectory, c: Channel) -> tuple[CueTrajectory, str]:
    """The channel as a part of its coordinate, and what was done to it in words."""
    words = []
    low_pass = c.low_pass_hz or (SPEED_LOW_PASS_HZ if c.kind == "speed" else None)
    if low_pass is not None:
        source = source.low_passed(low_pass)
        words.append(f"low-passed at {low_pass:g} Hz")
    if c.kind in ("angle", "length"):
        return source, ", ".join([*words, "as it is"])
    values = source.poses[:, 0]
    if c.kind == "speed":
        values = np.gradient(values, source.step_s)
        words.append("differentiated")
    washed = _washed(values, c, source.step_s)
    is_tilt = c.kind != "angular rate" and c.coordinate in ("pitch", "roll")
    words.append("felt as tilt" if is_tilt else "washed out")
    return replace(source, poses=washed[:, None]), ", ".join(words)


def _washed(values: Array, c: Channel, dt_s: float) -> Array:
    """Pose (m,) of one coordinate when one acceleration or rate (m,) alone moves the vehicle."""
    washout = Washout((c.coordinate,), dt_s, WashoutSettings(gain=1.0))
    inputs = np.zeros((len(values), 2, 3))
    if c.kind == "angular rate":
        inputs[:, 1, _TURNED_BY[c.coordinate]] = values
    else:
        inputs[:, 0, _TILTED_BY[c.coordinate]] = values
    return np.array([washout.step(acceleration, omega)[0] for acceleration, omega in inputs])
