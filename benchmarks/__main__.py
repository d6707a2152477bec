"""`python -m benchmarks [NAME ...]`: measure all figures, or those named, and print their tables."""

from __future__ import annotations

import argparse
import importlib
import json
import os
import platform
import sys
import time
from pathlib import Path
from typing import Any

from benchmarks.figure import Options, Table

NAMES = (
    "tracking",
    "operation",
    "cia402",
    "step_cost",
    "loop_lateness",
    "sim_vs_mujoco",
    "rigs_vs_pinocchio",
    "identify_time",
    "interval_coverage",
    "bicycle_vs_generated",
)


def machine() -> str:
    """Where this runs and how busy it is now."""
    loads = " ".join(f"{load:.1f}" for load in os.getloadavg())
    return (
        f"{os.cpu_count()} CPUs, {platform.machine()}, {platform.system()} {platform.release()}, "
        f"Python {platform.python_version()}, load average {loads}"
    )


def run(name: str, options: Options) -> list[Table]:
    """The tables of one measurement."""
    return list(importlib.import_module(f"benchmarks.{name}").measure(options))


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__)
    parser.add_argument("names", nargs="*", metavar="NAME", help=", ".join(NAMES))
    parser.add_argument("--quick", action="store_true", help="short runs, no figures to quote")
    parser.add_argument("--json", action="store_true", help="JSON on standard output")
    parser.add_argument("--plots", type=Path, metavar="FOLDER", help="write plots there (tracking)")
    parser.add_argument(
        "--save",
        type=Path,
        metavar="FILE",
        help="keep rows there, go on from there (cia402, interval_coverage)",
    )
    parser.add_argument(
        "--parts",
        nargs="+",
        default=(),
        metavar="PART",
        help="only these rows (the same): real-1000, stewart",
    )
    given = parser.parse_args()
    if unknown := set(given.names) - set(NAMES):
        parser.error(f"no figure {', '.join(sorted(unknown))}; there are {', '.join(NAMES)}")
    options = Options(given.quick, given.plots, given.save, tuple(given.parts))
    results: dict[str, dict[str, Any]] = {}
    for name in given.names or NAMES:
        before, started_s = machine(), time.monotonic()
        tables = run(name, options)
        took_s = time.monotonic() - started_s
        results[name] = {"machine": before, "took_s": took_s, "tables": tables}
        if not given.json:
            print(f"== {name} ({took_s:.0f} s; {before})\n")
            print("\n\n".join(table.text() for table in tables) + "\n", flush=True)
    if given.json:
        plain = {n: {**r, "tables": [t.as_json() for t in r["tables"]]} for n, r in results.items()}
        json.dump(plain, sys.stdout, indent=2, ensure_ascii=False)
        print()


if __name__ == "__main__":
    main()
