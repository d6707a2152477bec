"""Columns of a foreign log as signals in SI units, by the map."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from hil.config import RigFile
from hil.errors import RunError
from hil.runs.importing.clocks import Timeline, timeline
from hil.runs.importing.mapfile import Clock, ImportMap, MappedSignal, Term
from hil.runs.importing.source import Array, Source
from hil.runs.importing.units import SI, UNITS, kinds_of
from hil.runs.table import check_signals


@dataclass(frozen=True, slots=True)
class Signal:
    """One signal in SI units on its clock; NaN where not sampled."""

    name: str
    column: str
    unit: str
    """SI."""
    given: str
    """The unit that the map says."""
    line: Timeline
    values: Array

    def samples(self) -> tuple[Array, Array]:
        """Stamps (s from the clock's first) and values where sampled."""
        there = ~np.isnan(self.values)
        return self.line.t_s[there], self.values[there]


class Converter:
    """Makes signals of one source; columns with the same clock share its timeline."""

    def __init__(self, source: Source, clock: Clock) -> None:
        self._source = source
        self._clock = clock
        self._lines: dict[tuple[Clock, str], Timeline] = {}

    @property
    def lines(self) -> list[Timeline]:
        """The clocks used so far."""
        return list(self._lines.values())

    def signal(self, name: str, mapped: MappedSignal) -> Signal:
        """The signal `name`; RunError where a column, its length, its unit or its clock is wrong."""
        source = self._source
        own = source.unit_of(mapped.column)
        if own is not None and own != mapped.unit and mapped.scale == 1.0 and not mapped.times:
            raise RunError(
                f"{source.path}: {mapped.column} is in {own} by the log's own description, the map says "
                f"{mapped.unit}"
            )
        column = source.column(mapped.column)
        length, group = len(column.values), column.group
        key = (mapped.time or self._clock, group)
        if key not in self._lines:
            self._lines[key] = timeline(source, key[0], group, length)
        line = self._lines[key]
        if length != line.length:
            raise RunError(
                f"{source.path}: column {mapped.column} holds {length} values, its clock {line.label} "
                f"{line.length}"
            )
        value = self._term(mapped, length, group) + mapped.offset
        for term in mapped.plus:
            value = value + self._term(term, length, group)
        kind, factor = UNITS[mapped.unit]
        value = mapped.sign * factor * value
        unstamped = np.ones(length, dtype=bool)
        unstamped[line.rows] = False
        lost = np.flatnonzero(unstamped & ~np.isnan(value))
        if lost.size:
            raise RunError(f"{line.where}, row {int(lost[0]) + 1}: is empty")
        return Signal(name, mapped.column, SI[kind], mapped.unit, line, value[line.rows])

    def _term(self, term: Term, length: int, group: str) -> Array:
        value = term.scale * (self._factor(term.column, length, group) - term.zero)
        for name in term.times:
            value = value * self._factor(name, length, group)
        for name in term.divided_by:
            by = self._factor(name, length, group)
            zeros = np.flatnonzero(by == 0.0)
            if zeros.size:
                place = f", row {int(zeros[0]) + 1}" if len(by) > 1 else ""
                raise RunError(
                    f"{self._source.path}: column {name}{place}: is 0, the map divides by it"
                )
            value = value / by
        return value

    def _factor(self, name: str, length: int, group: str) -> Array:
        column = self._source.column(name)
        if len(column.values) != 1 and (len(column.values) != length or column.group != group):
            raise RunError(
                f"{self._source.path}: column {name} holds {len(column.values)} values, it cannot go "
                f"with one of {length}"
            )
        return column.values


def check_map(mapped: ImportMap, rig: RigFile | None, source: Path) -> None:
    """RunError where the map names a signal that the rig has not, or gives it a unit it cannot have."""
    check_signals(mapped.signals, str(source), rig)
    for name, signal in mapped.signals.items():
        kinds = kinds_of(name, rig)
        kind = UNITS[signal.unit][0]
        if kind not in kinds:
            fitting = ", ".join(u for u, (k, _) in UNITS.items() if k in kinds)
            article = "an" if kinds[0][0] in "aeiou" else "a"
            raise RunError(
                f"{source}: signals.{name}: is {article} {' or '.join(kinds)}, which cannot be in "
                f"{signal.unit!r}; it can be in {fitting}"
            )


def wanted_columns(mapped: ImportMap) -> tuple[set[str], set[str]]:
    """Names of all columns that the map needs, and of its time columns."""
    signals: Mapping[str, MappedSignal] = {**mapped.signals, **mapped.extra}
    columns: set[str] = set()
    clocks = {c.column for c in (mapped.time, *(s.time for s in signals.values() if s.time))}
    for signal in signals.values():
        for term in (signal, *signal.plus):
            columns |= {term.column, *term.times, *term.divided_by}
    return columns, {name for name in clocks if name is not None}
