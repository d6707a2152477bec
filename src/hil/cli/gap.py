"""`hil gap`: where the twin differs from the rig, and why."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.table import Column, Table

from hil.cli.console import out
from hil.cli.exam import app as exam
from hil.cli.gap_apply import apply
from hil.cli.gap_batch import batch
from hil.cli.gap_diagnose import diagnose
from hil.cli.gap_next import next_experiment
from hil.cli.gap_rest import rest
from hil.cli.outputs import JsonFile, Outputs, Page
from hil.configfile import load_any_rig
from hil.effectlines import checked
from hil.gap import Located
from hil.gap.bicycle import locate_any
from hil.runs import load_run
from hil.ui.gap_page import gap_page

app = typer.Typer(
    help="The gap between a rig and its twin: where it stands, which effect makes it, how far it shrinks.",
    no_args_is_help=True,
)

app.add_typer(exam, name="exam")
app.command("next")(next_experiment)
app.command("rest")(rest)

_STYLE = {"error": "red", "warning": "yellow", "info": ""}


@app.callback()
def group() -> None:
    """The sim-to-real gap."""


@app.command()
def locate(
    runs: Annotated[
        list[Path], typer.Argument(metavar="RUN...", help="Run folders or .mcap files of one rig.")
    ],
    rig: Annotated[str, typer.Option("--rig", help="Rig file whose twin is meant, or its name.")],
    json: JsonFile = None,
    report: Page = None,
    seed: Annotated[int, typer.Option(min=0, help="Of the noise that is drawn.")] = 0,
) -> None:
    """Find the gap by signal, frequency band and operating region, above the floor of noise."""
    outputs = Outputs(json, report)
    outputs.make_ready()
    settings = checked(load_any_rig(rig), rig)
    loaded = [load_run(path, settings) for path in runs]
    found = locate_any(loaded, settings, seed=seed)
    outputs.give(found.to_json, lambda path: gap_page(found, path), lambda: _show(found))


app.command()(diagnose)
app.command()(apply)
app.command()(batch)


def _show(found: Located) -> None:
    for f in found.findings:
        out.print(f"{f.subject}: {f.text}", style=_STYLE[f.severity], soft_wrap=True)
    table = Table(Column("signal", no_wrap=True), "twin off by", "floor", "times", "share of gap")
    for column in table.columns[1:]:
        column.justify = "right"
    for s in found.signals:
        table.add_row(
            s.signal,
            f"{s.before:.3g} {s.unit}",
            f"{s.noise_floor:.3g}",
            f"{s.ratio:.2f}",
            f"{100.0 * s.share:.0f} %" if found.is_gap else "",
        )
    out.print(table)
    if found.where:
        out.print(_places(found))
    for n in found.nuisances:
        if n.at_bound:
            out.print(
                f"{n.name} wants to go further than a calibration may ({n.change:+.3g} {n.unit}): a "
                "gap pulls at it, or it is wrong in the rig file",
                style="yellow", soft_wrap=True,
            )  # fmt: skip
    out.print(f"floor: {found.floor_text}", soft_wrap=True)
    out.print(found.sentence, style="bold", soft_wrap=True)


def _places(found: Located) -> Table:
    where = Table(
        Column("where", no_wrap=True),
        "band, Hz",
        "region",
        "share of gap",
        "90 %",
        "times the floor",
    )
    for p in found.where:
        where.add_row(
            p.signal,
            f"{p.band_hz[0]:g} … {p.band_hz[1]:.3g}",
            p.region.replace("_", " "),
            f"{100.0 * p.share:.0f} %",
            f"{100.0 * p.share_ci[0]:.0f} … {100.0 * p.share_ci[1]:.0f} %",
            f"{p.rms / p.noise_floor:.1f}",
        )
    return where
