"""What a measurement hands back: tables that print and turn into JSON."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

Cell = str | float | int


@dataclass(frozen=True, slots=True)
class Options:
    """How much to measure, and where plots go (None: nowhere)."""

    quick: bool = False
    """Enough to see that it works and who is faster; too short for figures to quote."""
    plots: Path | None = None
    save: Path | None = None
    """Where rows of a long measurement are kept as they come, and taken from where they are known."""
    parts: tuple[str, ...] = ()
    """Of a long measurement, by the beginning of their names; empty: all."""


@dataclass(frozen=True, slots=True)
class Table:
    """One table: the first column names the row, `columns` name the others with their units."""

    title: str
    columns: tuple[str, ...]
    rows: Mapping[str, tuple[Cell, ...]]
    note: str = ""

    def __post_init__(self) -> None:
        for name, cells in self.rows.items():
            if len(cells) != len(self.columns):
                raise ValueError(f"{self.title}: {name} has {len(cells)} of {len(self.columns)}")

    def column(self, name: str) -> dict[str, Cell]:
        """One column, by row."""
        k = self.columns.index(name)
        return {row: cells[k] for row, cells in self.rows.items()}

    def value(self, row: str, column: str) -> float:
        """One number; TypeError where it is a word."""
        cell = self.rows[row][self.columns.index(column)]
        if isinstance(cell, str):
            raise TypeError(f"{self.title}: {row}, {column} is {cell!r}")
        return float(cell)

    def text(self) -> str:
        """Aligned columns under the title."""
        body = [(name, *map(_shown, cells)) for name, cells in self.rows.items()]
        head = ("", *self.columns)
        widths = [max(len(line[k]) for line in (head, *body)) for k in range(len(head))]
        lines = [
            "  ".join(
                cell.ljust(w) if k == 0 else cell.rjust(w)
                for k, (cell, w) in enumerate(zip(line, widths, strict=True))
            ).rstrip()
            for line in (head, *body)
        ]
        return "\n".join([self.title, *lines, *([self.note] if self.note else [])])

    def as_json(self) -> dict[str, object]:
        """The table as plain values; what is not finite becomes null."""
        rows = {
            name: dict(zip(self.columns, map(plain, cells), strict=True))
            for name, cells in self.rows.items()
        }
        return {"title": self.title, "rows": rows, "note": self.note}


def _shown(cell: Cell) -> str:
    if not isinstance(cell, float):
        return str(cell)
    if not math.isfinite(cell):
        return "-"
    return f"{cell:.0f}" if abs(cell) >= 1000.0 else f"{cell:.3g}"


def plain(cell: Cell) -> Cell | None:
    """The cell as JSON has it: what is not finite is null."""
    return None if isinstance(cell, float) and not math.isfinite(cell) else cell
