"""Files of separated values: their lines without comments, and the table that they hold."""

from __future__ import annotations

import bz2
import gzip
import io
import itertools
import lzma
import re
import warnings
import zlib
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any, Final

import pandas as pd

from hil.errors import RunError

_OPENERS: Final[dict[str, Callable[..., Any]]] = {
    ".gz": gzip.open,
    ".bz2": bz2.open,
    ".xz": lzma.open,
}
_SHEET_FAULT: Final = re.compile(r"#(N/A|DIV/0!|VALUE!|REF!|NAME\?|NUM!|NULL!)")
"""What spreadsheets write in a cell that they could not reckon: a row may begin with it."""
_LINES: Final = 4096
"""Handed to pandas at a time: it takes more than it asks for."""


def csv_lines(
    path: Path, *, comment: str | None = None, skip_rows: int = 0, encoding: str = "utf-8"
) -> Iterator[str]:
    """The lines of a text file, compressed too; empty ones for comments and the first `skip_rows`.

    A comment is a line that begins with the sign `comment`: further on it is part of a cell.
    OSError and whatever else decompressing raises, UnicodeError where it is no text.
    """
    opener = _OPENERS.get(path.suffix.lower(), open)
    with opener(path, "rt", encoding=encoding) as stream:
        for number, line in enumerate(stream):
            text = line if number else line.removeprefix("\ufeff")
            yield "\n" if number < skip_rows or _is_comment(text, comment) else text


def csv_table(
    path: Path,
    *,
    comment: str | None = None,
    skip_rows: int = 0,
    encoding: str = "utf-8",
    **how: Any,
) -> pd.DataFrame:
    """The table in a CSV file, lines as of `csv_lines`; `how` as pandas has it. RunError where it is none.

    So is one with more cells in a row than it has columns: read on, they would stand under others. For
    that all columns are read: where some are chosen, pandas drops the surplus without a word.
    """
    lines = csv_lines(path, comment=comment, skip_rows=skip_rows, encoding=encoding)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", pd.errors.ParserWarning)
            table: pd.DataFrame = pd.read_csv(
                _Text(lines), index_col=False, skipinitialspace=True, low_memory=False, **how
            )
    except (pd.errors.ParserError, pd.errors.ParserWarning, pd.errors.EmptyDataError) as error:
        raise RunError(f"{path}: is no table of separated values: {error}") from error
    except UnicodeError as error:
        raise RunError(f"{path}: is no text: {error}") from error
    except (OSError, EOFError, zlib.error, lzma.LZMAError) as error:
        raise RunError(f"{path}: cannot be read: {error}") from error
    return table


class _Text(io.TextIOBase):
    """Lines as a file that pandas reads."""

    def __init__(self, lines: Iterable[str]) -> None:
        self._lines = iter(lines)

    def readable(self) -> bool:
        return True

    def read(self, size: int | None = -1, /) -> str:
        return "".join(itertools.islice(self._lines, _LINES))


def _is_comment(line: str, comment: str | None) -> bool:
    text = line.lstrip()
    return comment is not None and text.startswith(comment) and not _SHEET_FAULT.match(text)
