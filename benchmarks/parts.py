"""A long measurement in parts: each row is told and kept as soon as it is there, and need not be taken again.

Rows are kept in a JSON file with the machine's load and the time they took; whoever goes on with the same
file measures only what it lacks.
"""

from __future__ import annotations

import json
import math
import os
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from benchmarks.figure import Cell, Options, Table, plain


@dataclass(frozen=True, slots=True)
class Part:
    """One row of a table: how it is named on the command line, where it stands, and how it is measured."""

    name: str
    table: Table
    """Without rows."""
    row: str
    measure: Callable[[], tuple[Cell, ...]]


def chosen(parts: Sequence[Part], names: Sequence[str]) -> list[Part]:
    """Those whose names begin with one of `names`, or all; SystemExit where a name fits nothing."""
    for name in names:
        if not any(part.name.startswith(name) for part in parts):
            known = ", ".join(part.name for part in parts)
            raise SystemExit(f"no part {name!r}; there are {known}")
    return [p for p in parts if not names or p.name.startswith(tuple(names))]


def measured(parts: Sequence[Part], options: Options) -> list[Table]:
    """The tables of the parts chosen, each as far as its rows are known."""
    kept: dict[str, dict[str, object]] = {}
    if options.save is not None and options.save.exists():
        kept = json.loads(options.save.read_text(encoding="utf-8"))
    wanted = chosen(parts, options.parts)
    for k, part in enumerate(wanted, start=1):
        key = f"{part.table.title}: {part.row}"
        if key in kept:
            continue
        _tell(f"[{k}/{len(wanted)}] {part.name}: {part.row} ...")
        began_s = time.monotonic()
        cells = part.measure()
        took_s = time.monotonic() - began_s
        kept[key] = {
            "cells": [plain(cell) for cell in cells],
            "load": round(os.getloadavg()[0], 1),
            "took_s": round(took_s, 1),
        }
        told = ", ".join(
            f"{column} {cell:.3g}" if isinstance(cell, float) else f"{column} {cell}"
            for column, cell in zip(part.table.columns, cells, strict=True)
        )
        _tell(f"[{k}/{len(wanted)}] {part.name}: {took_s:.0f} s; {told}")
        if options.save is not None:
            options.save.write_text(
                json.dumps(kept, indent=1, ensure_ascii=False), encoding="utf-8"
            )
    return _tables(parts, kept)


def _tables(parts: Sequence[Part], kept: dict[str, dict[str, object]]) -> list[Table]:
    tables = []
    for blank in dict.fromkeys(id(p.table) for p in parts):
        of = [p for p in parts if id(p.table) == blank]
        empty = of[0].table
        found = {p.row: kept.get(f"{empty.title}: {p.row}") for p in of}
        rows = {row: _cells(entry["cells"]) for row, entry in found.items() if entry is not None}
        loads = ", ".join(str(entry["load"]) for entry in found.values() if entry is not None)
        if rows:
            note = f"{empty.note}; {os.cpu_count()} CPUs, load average after each row: {loads}"
            tables.append(Table(empty.title, empty.columns, rows, note))
    return tables


def _cells(cells: object) -> tuple[Cell, ...]:
    assert isinstance(cells, list)
    return tuple(math.nan if cell is None else cell for cell in cells)


def _tell(text: str) -> None:
    print(text, file=sys.stderr, flush=True)
