"""`hil gap rest`: what an accelerometer that lay in many poses says about itself."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.table import Table

from hil.cli.console import out, write_json
from hil.gap.rest import diagnose_at_rest
from hil.runs import load_run


def rest(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="Run folder with imu.accel_x, y, z.")],
    gravity: Annotated[float, typer.Option(min=9.7, max=9.9, help="Of the place, m/s².")] = 9.80665,
    as_json: Annotated[bool, typer.Option("--json", help="Write JSON instead of text.")] = False,
) -> None:
    """Find bias, scale and misalignment of an accelerometer from its rests; no rig file is needed."""
    found = diagnose_at_rest(load_run(run), gravity)
    if as_json:
        write_json(found.table())
        return
    table = Table("effects", "|a| off g on unseen rests, m/s²")
    for some, left in found.by_set.items():
        table.add_row(" + ".join(some) or "none", f"{left:.4g}")
    out.print(table)
    out.print(found.sentence, style="bold", soft_wrap=True)
