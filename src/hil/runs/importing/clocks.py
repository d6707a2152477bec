"""The clocks of a foreign log: stamps in seconds from their first, and what is wrong with them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from hil.errors import RunError
from hil.runs.importing.findings import Finding
from hil.runs.importing.mapfile import Clock
from hil.runs.importing.source import Array, Source, Stamps
from hil.runs.table import check_increasing

_FACTORS: Final = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "datetime": 1e-9}
SNAP: Final = 0.05
"""A stamp this share of a period off the grid of `rate` is no longer the same instant."""
GAP: Final = 3.0
"""Steps longer than this many usual steps are gaps."""
TURN: Final = 50
"""Rows at most that a log may write in one turn, signal after signal, before it waits for the next turn."""
REGULAR: Final = 0.5
"""Of the rows in a turn, by which the middle half of the turns may differ: rows that are lost leave any
number between them."""
SLOWEST_S, FASTEST_S = 0.5, 1e-5
"""Usual steps outside these are no log of a rig's motion: the time's unit is wrong."""


@dataclass(frozen=True, slots=True)
class Timeline:
    """Stamps of one clock: s from its own first stamp, rising or equal."""

    label: str
    where: str
    """For sentences: file and column."""
    row_word: str
    origin_s: float
    """The first stamp as the log has it, shift added."""
    t_s: Array
    rows: npt.NDArray[np.intp]
    """Place of each stamp in its column, from 0; rows without a stamp are left out."""
    length: int
    """Rows of the column, with those left out."""


def timeline(source: Source, clock: Clock, group: str, length: int) -> Timeline:
    """The stamps for columns of `length` rows; RunError where time is empty, runs back or is off `rate`."""
    label = clock.column or ("" if clock.rate is None else f"{clock.rate:g} Hz")
    label = f"{group} {label or 'log time'}".strip()
    where = f"{source.path}: " + (f"column {clock.column}" if clock.column else f"clock {label}")
    if length < 2:
        raise RunError(f"{source.path}: holds {length} {source.row_word}s, that is no run")
    if clock.column is None and clock.rate is not None:
        rows = np.arange(length)
        return Timeline(label, where, source.row_word, clock.shift, rows / clock.rate, rows, length)
    raw = source.stamps(clock.column, group, dates=clock.unit == "datetime")
    if len(raw) != length:
        raise RunError(f"{where}: holds {len(raw)} stamps for columns of {length} values")
    t, origin, rows = _seconds(raw, clock, where)
    check_increasing(t + origin, where, source.row_word, strictly=False)
    if t[-1] == 0.0:
        raise RunError(f"{where}: every stamp is {origin:.6f} s: is it a clock?")
    if clock.rate is not None:
        t = _snapped(t, clock.rate, where, source.row_word)
    return Timeline(label, where, source.row_word, origin + clock.shift, t, rows, length)


def _seconds(raw: Stamps, clock: Clock, where: str) -> tuple[Array, float, npt.NDArray[np.intp]]:
    """(s from the first stamp, the first stamp, rows that have one); integers lose no digit."""
    if clock.unit == "samples" and clock.rate:
        factor = 1.0 / clock.rate
    else:  # a log's own stamps are ns, whatever the map says of columns
        factor = _FACTORS[clock.unit] if clock.column else 1e-9
    lacking = np.isnat(raw) if raw.dtype.kind == "M" else np.isnan(raw)
    rows = np.flatnonzero(~lacking)
    if len(rows) < 2:
        raise RunError(f"{where}: holds {len(rows)} stamps, that is no run")
    there = raw[rows]
    if there.dtype.kind == "M":
        there, factor = there.astype("datetime64[ns]").astype(np.int64), 1e-9
    return (there - there[0]) * factor, float(there[0]) * factor, rows


def _snapped(t: Array, rate: float, where: str, row_word: str) -> Array:
    counts = np.round(t * rate)
    off = np.abs(t * rate - counts)
    worst = int(np.argmax(off))
    if off[worst] > SNAP:
        raise RunError(
            f"{where}: {row_word} {worst + 1}: its stamp {t[worst]:.6f} s after the first lies "
            f"{off[worst] / rate * 1e3:.3g} ms off the grid of {rate:g} Hz; leave `rate` out of the map "
            "to keep stamps as they are"
        )
    return np.asarray(counts / rate)


def usual_step_s(line: Timeline) -> float:
    """Median of the steps from one instant to the next."""
    steps = np.diff(line.t_s)
    moving = steps[steps > 0.0]
    return float(np.median(moving)) if moving.size else 0.0


def is_of_motion(step_s: float) -> bool:
    """Whether a log of a rig's motion may have a sample each `step_s`."""
    return FASTEST_S <= step_s <= SLOWEST_S


def check_clock(line: Timeline) -> list[Finding]:
    """Duplicate stamps, jitter, gaps, and a unit that cannot be."""
    steps = np.diff(line.t_s)
    found: list[Finding] = []
    same = np.flatnonzero(steps == 0.0)
    if same.size:
        k = int(line.rows[same[0]]) + 1
        found.append(
            Finding(
                "duplicate_stamps", line.label, "fault",
                f"{line.where}: {line.row_word}s {k} and {k + 1} have the same stamp "
                f"{line.t_s[same[0]]:.6f} s ({same.size} pairs in all); allow it in the map to keep the "
                "last of each, or give [time] a finer column or a rate",
            )
        )  # fmt: skip
    moving = steps[steps > 0.0]
    usual = usual_step_s(line)
    if not is_of_motion(usual):
        unit = "ms or finer" if usual > SLOWEST_S else "coarser"
        found.append(
            Finding(
                "time_unit", line.label, "warning",
                f"{line.where}: a sample each {usual:.3g} s is no log of motion: is its unit {unit}?",
            )
        )  # fmt: skip
    wait = _wait(steps, usual)
    gaps = np.flatnonzero(steps > GAP * wait)
    if gaps.size:
        worst = int(gaps[np.argmax(steps[gaps])])
        found.append(
            Finding(
                "gaps", line.label, "warning",
                f"{line.where}: {gaps.size} gaps, the longest {steps[worst]:.4g} s after "
                f"{line.row_word} {int(line.rows[worst]) + 1} (usual step {usual * 1e3:.4g} ms)",
            )
        )  # fmt: skip
    whole = moving[moving <= GAP * usual]
    jitter = float(np.std(whole)) if whole.size else 0.0
    pace = f"{1.0 / usual:.6g} Hz, jitter {jitter * 1e3:.3f} ms"
    if wait > usual:  # signals in turns: the steps within a turn are no rate of the log
        pace = f"{usual * 1e3:.4g} ms apart, {wait * 1e3:.4g} ms between turns"
    found.insert(
        0,
        Finding(
            "clock", line.label, "ok",
            f"{len(line.t_s)} {line.row_word}s in {line.t_s[-1]:.6g} s, {pace}",
        ),
    )  # fmt: skip
    return found


def _wait(steps: Array, usual: float) -> float:
    """The usual step, or the wait between two turns of a log that writes its signals one after another."""
    long = np.flatnonzero(steps > GAP * usual)
    rows = np.diff(long)
    if rows.size < 2:
        return usual
    low, middle, high = np.quantile(rows, [0.25, 0.5, 0.75])
    is_turn = middle <= TURN and high - low <= REGULAR * middle
    return float(np.median(steps[long])) if is_turn else usual


def check_clocks(lines: Sequence[Timeline]) -> list[Finding]:
    """Whether several clocks of one log can be the same time."""
    found: list[Finding] = []
    if len(lines) < 2:
        return found
    first = lines[0]
    start, end = first.origin_s, first.origin_s + float(first.t_s[-1])
    for line in lines[1:]:
        a, b = line.origin_s, line.origin_s + float(line.t_s[-1])
        spans = (
            f"{line.where}: runs from {a:.6g} to {b:.6g} s, the clock {first.label} from {start:.6g} to "
            f"{end:.6g} s"
        )
        share = (min(b, end) - max(a, start)) / max(b - a, end - start)
        if share <= 0.0:
            text = f"{spans}: they have no instant in common; give one of them a `shift`"
            found.append(Finding("clock_span", line.label, "fault", text))
        elif share < 0.05:
            text = f"{spans}: only {share:.1%} in common; is a unit of time wrong?"
            found.append(Finding("clock_span", line.label, "fault", text))
        elif share < 0.99:
            text = f"{spans}: {share:.1%} in common; drift, or a log that began later"
            found.append(Finding("clock_span", line.label, "warning", text))
        else:
            text = f"agrees with the clock {first.label} in {share:.2%} of the time"
            found.append(Finding("clock_span", line.label, "ok", text))
    return found
