"""The table of a run: column `t` (s, increasing), then one column a signal, NaN where not sampled.

Samples stand where they were taken: nothing is resampled, a row often holds one value.
"""

from __future__ import annotations

import difflib
import re
from array import array
from collections.abc import Collection, Iterable
from pathlib import Path
from typing import Final

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from hil.config import AnyRig, BicycleFile
from hil.config.bicycle import SIGNALS as BICYCLE_SIGNALS
from hil.config.rig import COORDINATES_OF
from hil.errors import RunError
from hil.signals import IMU_QUANTITIES

ACTUATOR_QUANTITIES: Final = (
    "setpoint",
    "force_setpoint",
    "position",
    "velocity",
    "force",
    "current",
)

LARGEST: Final = 1e100
"""No signal of any unit is larger, and its square is still a number."""

_ANY_COORDINATE: Final = tuple(dict.fromkeys(c for names in COORDINATES_OF.values() for c in names))
_ANY_ACTUATOR: Final = re.compile(rf"[a-z][a-z0-9_]*\.({'|'.join(ACTUATOR_QUANTITIES)})")

_LENGTHS: Final = (("millimetres", 1e-3), ("micrometres", 1e-6))
_ANGLES: Final = (("degrees", np.pi / 180.0), ("milliradians", 1e-3))
"""Units that positions come in instead of SI's, and factors to that."""


class TableBuilder:
    """Collects samples signal by signal and makes the table of them."""

    def __init__(self) -> None:
        self._times: dict[str, array[float]] = {}
        self._values: dict[str, array[float]] = {}

    def add(self, signal: str, t_s: float, value: float) -> None:
        """Add one sample."""
        if signal not in self._times:
            self._times[signal] = array("d")
            self._values[signal] = array("d")
        self._times[signal].append(t_s)
        self._values[signal].append(value)

    def table(self, source: str, order: Iterable[str] = ()) -> pd.DataFrame:
        """All samples; samples of one instant share a row. RunError where a signal runs backwards.

        `order`: signals that come first, in this order; others follow in order of their first use.
        """
        names = [s for s in order if s in self._times]
        names += [s for s in self._times if s not in names]
        times = [np.frombuffer(self._times[s]) for s in names]
        for name, t in zip(names, times, strict=True):
            check_increasing(t, f"{source}: signal {name}", "sample", strictly=False)
        grid = np.unique(np.concatenate(times)) if times else np.empty(0)
        columns: dict[str, np.ndarray] = {"t": grid}
        for name, t in zip(names, times, strict=True):
            column = np.full(len(grid), np.nan)
            column[np.searchsorted(grid, t)] = np.frombuffer(self._values[name])
            columns[name] = column
        return pd.DataFrame(columns)


def signal_order(rig: AnyRig) -> list[str]:
    """Every signal that a recording of `rig` may hold, in the order of its columns."""
    return [
        *(BICYCLE_SIGNALS if isinstance(rig, BicycleFile) else ()),
        *(f"cue.{c}" for c in rig.coordinates),
        *(f"{a}.{q}" for a in rig.actuator_names for q in ACTUATOR_QUANTITIES),
        *(f"imu.{q}" for q in IMU_QUANTITIES),
    ]


def check_increasing(t: np.ndarray, what: str, row: str, *, strictly: bool) -> None:
    """RunError where `t` runs back; `what` and `row` name the place in the sentence."""
    steps = np.diff(t)
    bad = np.flatnonzero(steps <= 0.0 if strictly else steps < 0.0)
    if bad.size:
        k = int(bad[0]) + 1
        verb = "runs back" if steps[k - 1] < 0.0 else "stands still"
        raise RunError(
            f"{what}: time {verb} at {row} {k + 1}, from {t[k - 1]:.6f} s to {t[k]:.6f} s"
        )


def parquet_table(path: Path, wanted: Collection[str] | None = None) -> pd.DataFrame:
    """The `wanted` columns of a parquet file, or all; what pandas kept as an index is one of them.

    RunError where it cannot be read.
    """
    try:
        columns = None if wanted is None else [c for c in parquet_columns(path) if c in wanted]
        table: pd.DataFrame = pq.read_table(path, columns=columns).to_pandas(ignore_metadata=True)
    except (pa.ArrowException, OSError, ValueError) as error:
        raise RunError(f"{path}: cannot be read as parquet: {error}") from error
    return table


def parquet_columns(path: Path) -> list[str]:
    """Names of all columns of a parquet file; RunError where it cannot be read."""
    try:
        return list(pq.read_schema(path).names)
    except (pa.ArrowException, OSError, ValueError) as error:
        raise RunError(f"{path}: cannot be read as parquet: {error}") from error


def check_signals(names: Iterable[str], source: str, rig: AnyRig | None) -> None:
    """RunError for a signal that hil does not know, or that the rig has not."""
    known = signal_order(rig) if rig else None
    for name in names:
        if known is not None:
            if name in known:
                continue
            place = f"the rig {rig.name!r}" if rig else ""
        else:
            if _is_signal_of_some_rig(name):
                continue
            place = "hil"
        choices = known or [
            *(f"cue.{c}" for c in _ANY_COORDINATE),
            *(f"imu.{q}" for q in IMU_QUANTITIES),
            *BICYCLE_SIGNALS,
            *(f"{a}.{q}" for a in ("leg1", "slide", "axis") for q in ACTUATOR_QUANTITIES),
        ]
        near = difflib.get_close_matches(name, choices, 1)
        hint = f"; is {near[0]!r} meant?" if near else ""
        raise RunError(f"{source}: column {name!r} is no signal that {place} has{hint}")


def _is_signal_of_some_rig(name: str) -> bool:
    group, _, rest = name.partition(".")
    if group == "cue":
        return rest in _ANY_COORDINATE
    if group == "imu":
        return rest in IMU_QUANTITIES
    return name in BICYCLE_SIGNALS or _ANY_ACTUATOR.fullmatch(name) is not None


def check_table(table: pd.DataFrame, source: str, rig: AnyRig | None) -> pd.DataFrame:
    """`table` as float64, or RunError: what `load_run` promises of every run, whoever made it.

    Names file, column and row (counted from 1, the header not counted).
    """
    if "t" not in table.columns:
        raise RunError(f"{source}: has no column 't' (s)")
    names = [str(c) for c in table.columns if c != "t"]
    if len(set(names)) != len(names):
        raise RunError(f"{source}: a column stands there twice")
    check_signals(names, source, rig)
    if len(table) < 2 or not names:
        raise RunError(f"{source}: holds {len(table)} rows of {len(names)} signals, that is no run")
    numbers = {"t": finite_numbers(table["t"], source, "t"), **_all_numbers(table, names, source)}
    if np.isnan(numbers["t"]).any():
        row = int(np.flatnonzero(np.isnan(numbers["t"]))[0]) + 1
        raise RunError(f"{source}: column t, row {row}: is empty")
    check_increasing(numbers["t"], f"{source}: column t", "row", strictly=True)
    for name in names:
        if np.isnan(numbers[name]).all():
            raise RunError(
                f"{source}: column {name}, rows 1 to {len(table)}: holds no sample at all"
            )
        if rig is not None:
            _check_units(name, numbers[name], source, rig)
    return pd.DataFrame(numbers)


def _all_numbers(table: pd.DataFrame, names: list[str], source: str) -> dict[str, np.ndarray]:
    return {name: finite_numbers(table[name], source, name) for name in names}


def finite_numbers(column: pd.Series, source: str, name: str, *, decimal: str = ".") -> np.ndarray:
    """`column` as float64, NaN where empty; RunError: a cell is no finite number, beyond LARGEST, or a date.

    `decimal`: the decimal sign of numbers that are still text, as all of a column are where one is no number.
    """
    if column.dtype.kind in "mM" or isinstance(column.dtype, pd.DatetimeTZDtype):
        is_span = column.dtype.kind == "m"
        since = "x" if is_span else "(x - x.iloc[0])"
        raise RunError(
            f"{source}: column {name}: holds {column.dtype}, not numbers: convert it to seconds: with x the "
            f"column, {since}.dt.total_seconds()"
        )
    pointed = column
    if decimal != "." and not pd.api.types.is_numeric_dtype(column):
        pointed = column.str.translate(str.maketrans(f"{decimal}.", f".{decimal}"))
    values = pd.to_numeric(pointed, errors="coerce").to_numpy(dtype=float, na_value=np.nan)
    wrong = np.flatnonzero((np.isnan(values) & column.notna().to_numpy()) | np.isinf(values))
    if wrong.size:
        row = int(wrong[0])
        (value,) = column.iloc[[row]].tolist()  # Python's own: NumPy's would say its type
        raise RunError(f"{source}: column {name}, row {row + 1}: {value!r} is not a finite number")
    beyond = np.flatnonzero(np.abs(values) > LARGEST)
    if beyond.size:
        where, value = f"{source}: column {name}, row {int(beyond[0]) + 1}", values[beyond[0]]
        raise RunError(f"{where}: {value:g} is beyond {LARGEST:g}: no signal is so large")
    return np.asarray(values)


def _check_units(name: str, values: np.ndarray, source: str, rig: AnyRig) -> None:
    """RunError where most positions of an actuator lie far off its stroke: mm or degrees, say."""
    if isinstance(rig, BicycleFile):
        _check_angles(name, values, source)
        return
    actuator, _, quantity = name.partition(".")
    if quantity not in ("position", "setpoint") or actuator not in rig.actuator_names:
        return
    low, high = rig.actuators[rig.actuator_names.index(actuator)].stroke
    span = high - low
    there = values[~np.isnan(values)]
    outside = (there < low - span) | (there > high + span)
    if outside.mean() <= 0.5:
        return
    worst = float(there[np.argmax(np.abs(there - 0.5 * (low + high)))])
    unit, others = ("rad", _ANGLES) if rig.is_rotary else ("m", _LENGTHS)
    guess = next(
        (f": are these {word}?" for word, f in others if low - span <= f * worst <= high + span),
        "",
    )
    row = int(np.flatnonzero(~np.isnan(values))[np.flatnonzero(outside)[0]]) + 1
    raise RunError(
        f"{source}: column {name}, from row {row}: most values, up to {worst:.4g}, lie far outside the "
        f"stroke {low}..{high} {unit} of the rig {rig.name!r}: wrong unit or wrong rig file{guess}"
    )


def _check_angles(name: str, values: np.ndarray, source: str) -> None:
    """RunError where a bicycle's lean or steer is beyond a right angle for long: degrees, surely."""
    if name not in ("lean", "steer"):
        return
    beyond = np.abs(values) > 0.5 * np.pi
    if beyond.sum() < 0.01 * (~np.isnan(values)).sum():
        return
    row = int(np.flatnonzero(beyond)[0])
    raise RunError(
        f"{source}: column {name}, from row {row + 1}: {values[row]:.4g} rad is beyond a right angle: are "
        "these degrees? or another channel, such as a wheel's angle?"
    )
