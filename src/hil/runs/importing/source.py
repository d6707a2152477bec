"""A foreign log that is open: columns by name, each with its own stamps where the log stamps messages."""

from __future__ import annotations

import difflib
from collections.abc import Collection, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np
import numpy.typing as npt

from hil.errors import RunError

Array = npt.NDArray[np.float64]
Stamps = npt.NDArray[np.generic]
"""Seconds in float64, or integers of any unit, or datetime64."""


@dataclass(frozen=True, slots=True)
class Column:
    """Values of one column, NaN where empty; `group` is its message or topic in a log of messages."""

    values: Array
    group: str = ""


class Source(Protocol):
    """An open log. `row_word` is what it calls a row in sentences."""

    path: Path
    row_word: str

    def column(self, name: str) -> Column:
        """The column `name`; RunError names the nearest where there is none, or the row that is no number."""

    def stamps(self, name: str | None, group: str, *, dates: bool) -> Stamps:
        """The time column `name` as it stands there (`dates`: as dates), or the log's own of `group`, ns."""

    def unit_of(self, name: str) -> str | None:
        """The unit that the log itself gives for a column, or None."""

    def notes(self) -> Iterable[str]:
        """What the reader passed over, in sentences."""


def no_such(path: Path, what: str, name: str, known: Collection[str]) -> RunError:
    """The error for a column that is not there, with the nearest that are."""
    near = difflib.get_close_matches(name, known, 3, 0.5)
    there = ", ".join(near) if near else ", ".join(list(known)[:12]) or "nothing"
    word = "nearest" if near else "it has"
    return RunError(f"{path}: has no {what} {name!r}; {word}: {there}")
