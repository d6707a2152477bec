"""`hil runs`: what was recorded, what is in it, and how to take it elsewhere."""

from __future__ import annotations

from dataclasses import asdict
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer
from rich.table import Table

from hil.cli.console import JsonFlag, out, write_json
from hil.cli.runs_import import import_command
from hil.errors import RunError
from hil.runs import export_run, list_runs, load_run, repair_run, signal_infos
from hil.ui.report import run_report
from hil.ui.report_summary import summary_lines

app = typer.Typer(
    help="Recordings: list, show, report, export, repair, import.", no_args_is_help=True
)
app.command("import")(import_command)

RunArgument = Annotated[
    Path,
    typer.Argument(metavar="RUN", help="A run folder, or an .mcap file.", show_default=False),
]


class Kind(StrEnum):
    """File formats of exported signals."""

    parquet = "parquet"
    csv = "csv"


@app.command("list")
def list_command(
    folder: Annotated[Path, typer.Argument(help="Folder of run folders.")] = Path("runs"),
    json: JsonFlag = False,
) -> None:
    """List the runs in a folder, newest first."""
    if not folder.is_dir():
        raise RunError(f"{folder}: no such folder")
    runs = list_runs(folder)
    if json:
        write_json([asdict(run) | {"path": str(run.path)} for run in runs])
        return
    table = Table("run", "mode", "seconds", "MB", "note")
    table.columns[0].no_wrap = True
    for run in runs:
        length = "–" if run.duration_s is None else f"{run.duration_s:.1f}"
        note = run.trouble or run.note
        table.add_row(run.path.name, run.mode, length, f"{run.size_bytes / 1e6:.1f}", note)
    out.print(table)


@app.command()
def show(run: RunArgument, json: JsonFlag = False) -> None:
    """Show what a run holds: ten lines of summary, and each signal with its count and rate."""
    loaded = load_run(run)
    signals = signal_infos(loaded)
    if json:
        write_json(
            {"summary": summary_lines(loaded), "signals": [asdict(signal) for signal in signals]}
        )
        return
    for line in summary_lines(loaded):
        out.print(line, soft_wrap=True)
    table = Table("signal", "samples", "rate", "longest gap", "lowest", "highest")
    for s in signals:
        table.add_row(
            s.name,
            str(s.samples),
            f"{s.rate_hz:.1f} Hz",
            f"{s.longest_gap_s * 1e3:.1f} ms",
            f"{s.lowest:.5g}",
            f"{s.highest:.5g}",
        )
    out.print(table)


@app.command()
def report(
    run: RunArgument,
    html: Annotated[
        Path | None,
        typer.Option("--out", help="The page; by default report.html in the run folder."),
    ] = None,
) -> None:
    """Write the page of plots of a run: one HTML file that needs nothing else."""
    target = html or (run if run.is_dir() else run.parent) / "report.html"
    out.print(str(run_report(load_run(run), target)), soft_wrap=True)


@app.command()
def export(
    run: RunArgument,
    folder: Annotated[Path, typer.Argument(help="The run folder to make.")],
    kind: Annotated[Kind, typer.Option(help="Format of the signals.")] = Kind.parquet,
) -> None:
    """Write a run as a folder that any tool reads: run.toml, and one column a signal."""
    out.print(str(export_run(load_run(run), folder, kind.value)), soft_wrap=True)


@app.command()
def repair(run: RunArgument) -> None:
    """Mend the recording of a daemon that was killed, so that Foxglove opens it too."""
    done = repair_run(run)
    said = f"mended ({done.damage})" if done.damage else "is whole, nothing to mend"
    out.print(f"{done.path}: {said}; {done.messages} messages", soft_wrap=True)
