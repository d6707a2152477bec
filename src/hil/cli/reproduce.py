"""`hil reproduce`: the papers that the project started from, played again on the simulated rigs."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Annotated

import typer
from rich.status import Status

from hil.cli.console import JsonFlag, err, out, write_json
from hil.cli.options import profiles_of
from hil.cli.outputs import make_ready
from hil.configfile import load_rig
from hil.ui.reproduce import FAST, FULL, Report, bicycle_report, motorcycle_report, stewart_report

app = typer.Typer(
    help="The papers again: their experiments on the simulated rigs, as one page beside what they show.",
    no_args_is_help=True,
)
OutOption = Annotated[
    Path | None, typer.Option("--out", help="The page; default reproduce_<paper>.html here.")
]
FastFlag = Annotated[
    bool, typer.Option("--fast", help="Short experiments: a look at the page, wide intervals.")
]
KeepOption = Annotated[
    Path | None,
    typer.Option("--runs", help="Keep the recordings in this folder; default: nowhere."),
]


@app.command()
def motorcycle(
    out_html: OutOption = None,
    fast: FastFlag = False,
    runs: KeepOption = None,
    json: JsonFlag = False,
) -> None:
    """ "Parameters Identification for Motorcycle Simulator's Platform Characterization", figures 3, 5–8."""
    _reproduce(motorcycle_report, "motorcycle", "motorcycle", out_html, fast, runs, json)


@app.command()
def stewart(
    out_html: OutOption = None,
    fast: FastFlag = False,
    runs: KeepOption = None,
    json: JsonFlag = False,
) -> None:
    """ "Towards Simulating a Mid-size Stewart Platform on a Large Hexapod Simulator", figures 2, 4–8."""
    _reproduce(stewart_report, "stewart", "stewart_pd", out_html, fast, runs, json)


@app.command()
def bicycle(
    out_html: OutOption = None,
    runs: KeepOption = None,
    measured: Annotated[
        Path | None,
        typer.Option(
            "--measured",
            help="Folder with impulse_windows.json and logs/ of a struck bicycle: its weave is added.",
        ),
    ] = None,
    json: JsonFlag = False,
) -> None:
    """ "Validation of multibody modeling and simulation using an instrumented bicycle", section 8."""
    page = out_html or Path("reproduce_bicycle.html")
    make_ready(page, runs and runs / "RUN")
    with (
        tempfile.TemporaryDirectory(prefix="hil-") as scratch,
        err.status("riding") as status,
    ):
        _say(bicycle_report(page, runs or Path(scratch), measured, _progress(status)), json)


def _reproduce(
    make: Callable[..., Report],
    paper: str,
    rig_name: str,
    out_html: Path | None,
    fast: bool,
    runs: Path | None,
    json: bool,
) -> None:
    rig = load_rig(rig_name)
    page = out_html or Path(f"reproduce_{paper}.html")
    make_ready(page, runs and runs / "RUN")
    with (
        tempfile.TemporaryDirectory(prefix="hil-") as scratch,
        err.status("playing the experiments") as status,
    ):
        report = make(
            rig, profiles_of(rig, rig_name), page, runs or Path(scratch), FAST if fast else FULL,
            _progress(status),
        )  # fmt: skip
    _say(report, json)


def _progress(status: Status) -> Callable[[str], None]:
    """Says a step on the status line, or where there is no terminal as a line."""

    def progress(text: str) -> None:
        if err.is_terminal:
            status.update(text)
        else:
            err.print(text, soft_wrap=True)

    return progress


def _say(report: Report, json: bool) -> None:
    if json:
        write_json({"page": str(report.path), "facts": report.facts})
    else:
        out.print(str(report.path), soft_wrap=True)
