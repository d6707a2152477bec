"""`hil identify`: what the parameters of a rig are, from its runs."""

from __future__ import annotations

from datetime import UTC, datetime
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any, cast

import msgspec
import typer
from rich.table import Table
from typer.core import TyperGroup

from hil.cli import identify_frequency
from hil.cli.console import JsonFlag, err, out, write_json
from hil.cli.outputs import Write, make_ready, make_ready_anew, write_all
from hil.configfile import find_rig_file, load_rig, toml_text, write_rig_file
from hil.effectlines import checked
from hil.identify.estimate import (
    Identification,
    LinearMethod,
    LinearOptions,
    Outcome,
    TwinOptions,
    fit_page,
    identify,
    identify_twin,
    updated_rig_text,
)
from hil.runs import load_run


class FitByDefault(TyperGroup):
    """`hil identify RUN ...` is `hil identify fit RUN ...`."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """What does not begin with a command's name begins a fit."""
        if args and args[0] not in self.commands and args[0] != "--help":
            args = ["fit", *args]
        rest: list[str] = super().parse_args(ctx, args)
        return rest


app = typer.Typer(
    cls=FitByDefault,
    help="What a rig's parameters are: from runs, with intervals, and what the data cannot tell.",
    no_args_is_help=True,
)
app.command()(identify_frequency.frf)
app.command("agard")(identify_frequency.agard_command)
app.command()(identify_frequency.agard_steps)


class Method(StrEnum):
    """Estimators, for the command line."""

    ols = "ols"
    wls = "wls"
    iv = "iv"
    adaptive = "adaptive"
    twin = "twin"
    grid = "grid"


class Body(StrEnum):
    """Sets of rigid-body parameters."""

    principal = "principal"
    full = "full"


@app.callback()
def group() -> None:
    """What a rig's parameters are: `hil identify RUN... --rig FILE` fits them."""


@app.command()
def fit(
    runs: Annotated[
        list[Path], typer.Argument(metavar="RUN...", help="Run folders or .mcap files.")
    ],
    rig: Annotated[str, typer.Option("--rig", help="Rig file of the rig that ran, or its name.")],
    method: Annotated[
        Method | None,
        typer.Option(
            help="ols, wls: least squares. iv: with instruments from the twin, where noise meets a closed "
            "loop. adaptive: the gradient law. twin: output error, anything by name. grid: a grid first. "
            "Default: iv where setpoints were recorded, else wls."
        ),
    ] = None,
    body: Annotated[
        Body, typer.Option(help="principal: mass and three moments; full: all ten (not for twin).")
    ] = Body.principal,
    parameters: Annotated[
        str | None,
        typer.Option(
            help="twin, grid: names to fit, separated by commas: mass.m, leg1.viscous, all.force_gain, "
            "leg1.transport_delay.delay ..."
        ),
    ] = None,
    signals: Annotated[
        str, typer.Option(help="twin, grid: what to fit to: position,force,velocity,imu.")
    ] = "position,force",
    grid: Annotated[
        list[str] | None,
        typer.Option("--grid", help="grid: NAME=LOWEST:HIGHEST:POINTS, once for each axis."),
    ] = None,
    cutoff: Annotated[
        float | None,
        typer.Option(help="Cutoff of the filter, Hz; default by the sampling.", min=0.1),
    ] = None,
    write: Annotated[
        Path | None, typer.Option("--out", help="Write a new rig file with what was identified.")
    ] = None,
    page: Annotated[
        Path | None, typer.Option("--page", help="Write a page that shows the fit (HTML).")
    ] = None,
    json: JsonFlag = False,
) -> None:
    """Identify mass, inertia and friction from one or more runs. Exit 1 if the data tell nothing."""
    make_ready(page)
    make_ready_anew(write)
    settings = checked(load_rig(rig), rig)
    loaded = [load_run(path, settings) for path in runs]
    if method in (Method.twin, Method.grid):
        axes = _axes(grid or [])
        if (method is Method.grid) != bool(axes):
            raise typer.BadParameter("--method grid and --grid NAME=LOW:HIGH:POINTS go together")
        names = tuple(n.strip() for n in (parameters or "").split(",") if n.strip())
        names = names or tuple(axes)
        outcome = identify_twin(
            loaded, settings, TwinOptions(names, tuple(signals.split(",")), axes or None)
        )
    else:
        if parameters or grid:
            raise typer.BadParameter("--parameters and --grid are for --method twin and grid")
        options = LinearOptions(
            method=cast(LinearMethod, method.value) if method else None,
            body=body.value,
            cutoff_hz=cutoff,
        )
        outcome = identify(loaded, settings, options)
    result, writes = outcome.identification, dict[Path, Write]()
    if page is not None:
        writes[page] = lambda path: fit_page(result, outcome.curves, path)
    if write is not None:
        when = f"{datetime.now(UTC):%Y-%m-%d}"
        text = toml_text(find_rig_file(rig))
        writes[write] = lambda path: write_rig_file(path, updated_rig_text(text, result, when))
    try:
        write_all(writes)
    finally:
        _show(outcome, json=json)
    if page is not None:
        err.print(f"page: {page}", soft_wrap=True)
    if write is not None:
        err.print(f"rig file: {write}", soft_wrap=True)
    if not any(e.identifiable for e in result.estimates):
        raise typer.Exit(1)


def _axes(texts: list[str]) -> dict[str, tuple[float, float, int]]:
    axes = {}
    for text in texts:
        name, _, span = text.partition("=")
        try:
            low, high, points = span.split(":")
            axes[name.strip()] = (float(low), float(high), int(points))
        except ValueError as error:
            raise typer.BadParameter(f"--grid {text}: write NAME=LOWEST:HIGHEST:POINTS") from error
    return axes


def _show(outcome: Outcome, *, json: bool) -> None:
    result = outcome.identification
    if json:
        tables: Any = msgspec.json.decode(result.to_json())
        write_json(tables)
        return
    out.print(_table(result))
    for e in result.estimates:
        if e.reason:
            out.print(f"{e.name}: {e.reason}", style="yellow", soft_wrap=True)
    for text in result.untold:
        out.print(f"not told: {text}", soft_wrap=True)
    for text in result.notes:
        out.print(text, soft_wrap=True)
    shares = ", ".join(f"{name} {100.0 * x:.2g} %" for name, x in result.fit.items())
    out.print(f"left unexplained: {shares}", soft_wrap=True)


def _table(result: Identification) -> Table:
    table = Table("parameter", "value", "95 %", "unit", "rig file", "told")
    for column in table.columns[1:3]:
        column.justify = "right"
    table.columns[0].no_wrap = True
    for e in result.estimates:
        interval = f"{e.ci95[0]:.5g} … {e.ci95[1]:.5g}"
        told = "yes" if e.identifiable else "no"
        table.add_row(e.name, f"{e.value:.6g}", interval, e.unit, f"{e.nominal:.6g}", told)
    return table
