"""`python -m benchmarks.pooled MARKS.json ...`: the marks of several exams together, as a table of Markdown.

Shares are pooled by their counts, with Wilson's interval of all of them; the calibration error is that of the
pooled reliability table. Of medians nothing can be pooled: the lowest and the highest stand there.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

from hil.exam.intervals import share

SHOWN: Final = 0
"""Which group of a marks file: all cases at 3 times the floor and more."""
BARE: Final = 60
"""Cases below which a share stands as a count, "41 of 47"."""


def pooled(files: Sequence[Path]) -> list[tuple[str, str]]:
    """(mark, what it is over all files), in the order of the first file."""
    exams = [json.loads(f.read_text()) for f in files]
    marks = [{m["mark"]: m for m in e["groups"][SHOWN]["marks"]} for e in exams]
    rows = [("cases at 3 floors and more", str(sum(e["groups"][SHOWN]["papers"] for e in exams)))]
    for name in marks[0]:
        found = [m[name] for m in marks if name in m and m[name]["count"]]
        if name == "expected calibration error":
            rows.append((name, _calibration([e["reliability"] for e in exams])))
        elif found:
            rows.append((name, _together(name, found)))
    return rows


def _together(name: str, found: list[dict[str, Any]]) -> str:
    """One mark of all exams that have it."""
    values, counts = [m["value"] for m in found], [m["count"] for m in found]
    if name.startswith("parameter error"):  # medians, too
        return " to ".join(f"{100.0 * v:.1f}" for v in sorted({min(values), max(values)})) + " %"
    if "median" in name or "Brier" in name:
        return " to ".join(f"{v:.3g}" for v in sorted({min(values), max(values)}))
    total = sum(counts)
    hits = sum(v * n for v, n in zip(values, counts, strict=True))
    if "size" in name or "states" in name:
        return f"{hits / total:.2f}"
    right = round(hits)
    if total < BARE:
        return f"{right} of {total}"
    s = share([True] * right + [False] * (total - right))
    value, low, high = (100.0 * x for x in (s.value, s.low, s.high) if x is not None)
    return f"{value:.1f} % ({low:.0f} to {high:.0f}) of {total}"


def _calibration(tables: list[list[dict[str, float]]]) -> str:
    """|stated - came| of each tenth of probability over all exams, weighed by its cases."""
    stated: dict[float, float] = {}
    came: dict[float, float] = {}
    count = 0.0
    for row in (r for t in tables for r in t):
        tenth, n = row["from"], row["count"]
        stated[tenth] = stated.get(tenth, 0.0) + n * row["stated"]
        came[tenth] = came.get(tenth, 0.0) + n * row["came"]
        count += n
    return f"{sum(abs(stated[k] - came[k]) for k in stated) / count:.3f}" if count else ""


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.pooled", description=__doc__)
    parser.add_argument("files", nargs="+", type=Path, metavar="MARKS.json")
    for mark, value in pooled(parser.parse_args().files):
        print(f"| {mark} | {value} |")


if __name__ == "__main__":
    main()
