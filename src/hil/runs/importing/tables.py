"""Logs that are one table: CSV with any separator, also compressed, and parquet."""

from __future__ import annotations

import csv
import itertools
import lzma
import zlib
from collections.abc import Iterable
from pathlib import Path
from typing import Any, Final

import numpy as np
import pandas as pd

from hil.errors import RunError
from hil.runs.csvfile import csv_lines, csv_table
from hil.runs.importing.mapfile import FileSettings
from hil.runs.importing.source import Array, Column, Stamps, no_such
from hil.runs.table import finite_numbers, parquet_columns, parquet_table

_SEPARATORS: Final = (",", ";", "\t", "|")
_DECIMAL_COMMA: Final = r"\s*[-+]?\d+,\d+\s*"


class TableSource:
    """A table with one row an instant."""

    row_word = "row"

    def __init__(
        self, path: Path, table: pd.DataFrame, known: list[str], decimal: str = "."
    ) -> None:
        self.path = path
        self._table = table
        self._known = known
        self._decimal = decimal

    def column(self, name: str) -> Column:
        """The column `name`; RunError where it is not there, or a cell is no number."""
        return Column(self._numbers(name))

    def stamps(self, name: str | None, group: str, *, dates: bool) -> Stamps:
        """The time column as it stands there: integers stay integers, dates stay dates."""
        if name is None:
            raise RunError(
                f"{self.path}: a table has no clock of its own: give the map [time] column or rate"
            )
        series = self._series(name)
        if pd.api.types.is_datetime64_any_dtype(series):
            return _utc(series)
        if pd.api.types.is_integer_dtype(series) and not series.hasnans:
            return series.to_numpy(dtype=np.int64)
        if dates:
            return self._dates(series, name)
        return self._numbers(name)

    def _numbers(self, name: str) -> Array:
        series = self._series(name)
        try:
            return finite_numbers(series, str(self.path), name, decimal=self._decimal)
        except RunError as error:
            if self._decimal == "." and series.astype(str).str.fullmatch(_DECIMAL_COMMA).any():
                hint = 'are its decimal signs commas? say decimal = "," under [file] of the map'
                raise RunError(f"{error}: {hint}") from error
            raise

    def _dates(self, series: pd.Series[Any], name: str) -> Stamps:
        parsed = pd.to_datetime(series, errors="coerce", utc=True, format="ISO8601")
        wrong = np.flatnonzero(parsed.isna())
        if wrong.size:
            row = int(wrong[0])
            raise RunError(
                f"{self.path}: column {name}, row {row + 1}: {series.iloc[row]!r} is no date and time "
                "as in 2026-01-31T12:00:00.250Z"
            )
        return _utc(parsed)

    def unit_of(self, name: str) -> str | None:
        """Tables do not say."""
        return None

    def notes(self) -> Iterable[str]:
        """Nothing is passed over."""
        return ()

    def _series(self, name: str) -> pd.Series[Any]:
        if name not in self._table.columns:
            raise no_such(self.path, "column", name, self._known)
        return self._table[name]


def _utc(dates: pd.Series[Any]) -> Stamps:
    """In UTC without saying so; those that name no zone are taken for UTC, too."""
    if dates.dt.tz is not None:
        dates = dates.dt.tz_convert(None)
    stamps: Stamps = dates.to_numpy(dtype="datetime64[ns]")
    return stamps


def read_csv(path: Path, wanted: set[str], how: FileSettings) -> TableSource:
    """Read the `wanted` columns of a CSV file; RunError where it is none."""
    try:
        lines = _first_lines(path, how)
        separator = how.separator or _separator(lines, how.decimal)
        first = _split(lines[0], separator)
        has_header = how.header
        if has_header is None:
            has_header = not how.names and not all(_is_number(c, how.decimal) for c in first)
        known = first if has_header else list(how.names) or [str(k + 1) for k in range(len(first))]
        if len(set(known)) < len(known):
            twice = next(n for n in known if known.count(n) > 1)
            raise RunError(f"{path}: the column {twice!r} stands there twice")
        if len(known) != len(first):
            raise RunError(f"{path}: has {len(first)} columns, the map names {len(known)}")
        _check_widths(path, [_split(line, separator) for line in lines], len(known), has_header)
    except UnicodeError as error:
        raise _of_another_encoding(path, how, error) from error
    except (LookupError, csv.Error) as error:
        raise RunError(f"{path}: is no table of separated values: {error}") from error
    except (OSError, EOFError, zlib.error, lzma.LZMAError) as error:
        raise RunError(f"{path}: cannot be read: {error}") from error
    try:
        table = csv_table(
            path,
            sep=r"\s+" if separator == " " else separator,
            header=0 if has_header else None,
            names=known,
            skip_rows=how.skip_rows,
            comment=how.comment,
            decimal=how.decimal,
            encoding=how.encoding,
        )
    except RunError as error:
        if isinstance(error.__cause__, UnicodeError):  # further down than the first lines
            raise _of_another_encoding(path, how, error.__cause__) from error
        raise
    chosen = table[[name for name in known if name in wanted]]
    return TableSource(path, chosen, known, how.decimal)


def read_parquet(path: Path, wanted: set[str]) -> TableSource:
    """Read the `wanted` columns of a parquet file."""
    return TableSource(path, parquet_table(path, wanted), parquet_columns(path))


def _of_another_encoding(path: Path, how: FileSettings, error: UnicodeError) -> RunError:
    return RunError(
        f"{path}: is no text in {how.encoding}: {error}: if it is text, say its encoding under [file] of the "
        'map, as in encoding = "latin-1" or "utf-16"'
    )


def _first_lines(path: Path, how: FileSettings) -> list[str]:
    """Up to ten lines that hold something, comments left out."""
    lines = csv_lines(path, comment=how.comment, skip_rows=how.skip_rows, encoding=how.encoding)
    texts = (line.rstrip("\r\n") for line in lines)
    first = list(itertools.islice((text for text in texts if text.strip()), 10))
    if not first:
        raise RunError(f"{path}: is empty")
    return first


def _separator(lines: list[str], decimal: str) -> str:
    """The sign that stands most often, and equally often, in the first lines; else white space."""
    counts = {s: {line.count(s) for line in lines} for s in _SEPARATORS if s != decimal}
    even = [s for s, found in counts.items() if len(found) == 1 and min(found) > 0]
    if not even:
        even = [s for s, found in counts.items() if min(found) > 0]
    return max(even, key=lambda s: min(counts[s]), default=" ")


def _check_widths(path: Path, lines: list[list[str]], width: int, has_header: bool) -> None:
    """RunError where a row holds more than there are columns: read on, its cells would stand under others."""
    for row, cells in enumerate(lines[has_header:], 1):
        if any(cells[width:]):
            raise RunError(
                f"{path}: row {row}: has {len(cells)} cells, the first line names {width}: is a separator a "
                "sign of the numbers or of a name as well?"
            )


def _split(line: str, separator: str) -> list[str]:
    cells = (
        line.split()
        if separator == " "
        else next(csv.reader([line], delimiter=separator, skipinitialspace=True))
    )
    return [cell.strip().strip("'") for cell in cells]


def _is_number(cell: str, decimal: str) -> bool:
    if not cell:
        return True
    try:
        float(cell.replace(decimal, "."))
    except ValueError:
        return False
    return True
