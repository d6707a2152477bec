"""`hil rig workspace`: where a rig can go."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer
from rich.table import Table

from hil.cli.console import JsonFlag, RigArgument, out, write_json
from hil.configfile import load_rig
from hil.rigs import build_rig
from hil.ui.workspace import range_rows, survey, workspace_page

app = typer.Typer(help="A rig's mechanism: where it can go.", no_args_is_help=True)


@app.callback()
def rig() -> None:
    """A rig's mechanism: where it can go."""


@app.command()
def workspace(
    rig: RigArgument,
    html: Annotated[
        Path | None, typer.Option("--html", help="Also write a page of pictures there.")
    ] = None,
    length: Annotated[
        float,
        typer.Option(
            help="Length at which rotations count as translations, m.", min=0.01, max=10.0
        ),
    ] = 0.5,
    json: JsonFlag = False,
) -> None:
    """Say how far each coordinate goes, how much of the box of limits the strokes allow, how well it is
    conditioned.
    """
    settings = load_rig(rig)
    manipulator = build_rig(settings)
    found = survey(settings, manipulator, length)
    if html is not None:
        workspace_page(found, settings, manipulator, html)
    if json:
        values = asdict(found)
        ranges = {
            c: {"from": low, "to": high, "limit": limit}
            for c, (low, high), limit in zip(
                found.coordinates, found.ranges.tolist(), found.limits.tolist(), strict=True
            )
        }
        keep = (
            "box_share",
            "blocking",
            "condition_neutral",
            "condition_worst",
            "is_singular",
            "length_m",
        )
        write_json({"rig": settings.name, "ranges": ranges, **{k: values[k] for k in keep}})
        return
    table = Table("coordinate", "from", "to", "range", "limit", "unit", title=settings.name)
    for column in table.columns[1:5]:
        column.justify = "right"
    for row in range_rows(found):
        table.add_row(*row)
    out.print(table)
    out.print(
        f"{100.0 * found.box_share:.3g} % of the box of all limits lies inside the strokes"
        + _blockers(found.blocking)
    )
    out.print(
        f"condition number of the Jacobian: {found.condition_neutral:.3g} at neutral, "
        f"{found.condition_worst:.3g} at worst inside the strokes (rotations at {length:g} m)"
    )
    if found.is_singular:
        out.print("the determinant changes its sign inside the strokes: there are singular poses")
    if html is not None:
        out.print(str(html), soft_wrap=True)


def _blockers(blocking: dict[str, float]) -> str:
    """Which actuators' strokes end first, where any does."""
    worst = sorted(((share, name) for name, share in blocking.items() if share > 0.0), reverse=True)
    if not worst:
        return ""
    return "; where not, it is " + ", ".join(
        f"{name} in {100.0 * share:.0f} %" for share, name in worst
    )
