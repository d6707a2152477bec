"""`hil runs import`: brings anybody's log in as a run folder, and says what its checks found."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer
from rich.table import Column, Table

from hil.cli.console import JsonFlag, out, write_json
from hil.runs.importing import ImportReport, find_map, import_run

_STYLE = {"ok": "green", "note": "", "warning": "yellow"}


def import_command(
    file: Annotated[
        Path,
        typer.Argument(help="CSV (also .gz), parquet, MAT, MCAP, or a CAN log: BLF, ASC, candump."),
    ],
    map_name: Annotated[
        str,
        typer.Option(
            "--map", help="Which column is which signal: a map file, or one of hil's: emps."
        ),
    ],
    folder: Annotated[Path, typer.Option("--out", help="The run folder to make.")],
    rig: Annotated[
        str | None,
        typer.Option(
            "--rig", help="Rig file to hold the run against; default: the map's, if known."
        ),
    ] = None,
    json: JsonFlag = False,
) -> None:
    """Bring a log in as a run folder: units converted, clocks and signals checked."""
    report = import_run(file, find_map(map_name), folder, rig)
    if json:
        write_json(asdict(report))
        return
    _show(report)


def _show(report: ImportReport) -> None:
    names = Column("signal", no_wrap=True)
    signals = Table(names, "column", "unit", "clock", "samples", "rate", "lowest", "highest")
    for s in report.signals:
        signals.add_row(
            s.name, s.column, s.unit, s.clock, str(s.samples),
            f"{s.rate_hz:.4g} Hz",
            f"{s.lowest:.4g}",
            f"{s.highest:.4g}",
        )  # fmt: skip
    out.print(signals)
    checks = Table("check", "of", "verdict", Column("finding", overflow="fold"))
    for f in report.findings:
        checks.add_row(f.check, f.subject, f.verdict, f.text, style=_STYLE[f.verdict])
    out.print(checks)
    warnings = sum(f.verdict == "warning" for f in report.findings)
    out.print(
        f"{report.folder}: {report.rows} rows, {report.duration_s:.6g} s, rig {report.rig}; "
        f"{warnings or 'no'} warning{'' if warnings == 1 else 's'}",
        soft_wrap=True,
    )
