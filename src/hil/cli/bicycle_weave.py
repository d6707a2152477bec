"""`hil bicycle weave`: a struck bicycle's weave against the model over speed, and what makes them differ."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.table import Table

from hil.bicycle.weave import SteerControl, fit_impulses, read_matching, read_windows
from hil.bicycle.weave_causes import WeaveGap, diagnose_weave
from hil.cli.console import JsonFlag, err, out, write_json
from hil.configfile import load_bicycle
from hil.errors import ConfigError


def weave_command(
    windows: Annotated[
        Path,
        typer.Argument(
            metavar="WINDOWS", help="JSON: a list of {file, speed_mps, start, stop, p0, set}."
        ),
    ],
    logs: Annotated[
        Path, typer.Option("--logs", help="Folder of the logs: CSV (or .gz), lean_rate and speed.")
    ],
    rig: Annotated[
        str, typer.Option("--rig", help="The bicycle's file, or its name.")
    ] = "bicycle_delft",
    group: Annotated[
        str, typer.Option("--set", help="Only windows whose set ends with this: OFF, ON.")
    ] = "",
    gain: Annotated[
        float,
        typer.Option("--gain", help="Steer-into-lean: torque a lean rate, a m/s below --top."),
    ] = 0.0,
    top: Annotated[
        float, typer.Option("--top", min=0.0, help="Speed at which it ends, m/s.")
    ] = 0.0,
    matching: Annotated[
        Path | None,
        typer.Option(
            "--matching", help=".npz of a second law over speed: speeds_mps, mm_gains/F, G."
        ),
    ] = None,
    json: JsonFlag = False,
) -> None:
    """Fit the weave after each impulse, hold it against the model's eigenvalues, rank five causes.

    Steer friction, parameters, speed sensor, motor gain and steer encoder gain are each fitted to every
    second impulse and judged by the others.
    """
    bicycle = load_bicycle(rig)
    chosen = [w for w in read_windows(windows) if w.group.endswith(group)]
    if not chosen:
        raise ConfigError(f"{windows}: holds no window whose set ends with {group!r}")
    control = SteerControl(gain, top, None if matching is None else read_matching(matching))
    with err.status("fitting"):
        impulses = fit_impulses(chosen, logs, bicycle.rate)
        found = diagnose_weave(impulses, bicycle, control, group)
    if json:
        write_json(found.table())
        return
    _show(found)


def _show(found: WeaveGap) -> None:
    table = Table("speed", "impulses", "decay, 1/s", "model", "frequency, rad/s", "model")
    for r in found.rows:
        table.add_row(
            f"{r['speed']:g} m/s", str(r["impulses"]),
            f"{r['decay']:.2f} ± {r['decay_sd']:.2f}", f"{r['model_decay']:.2f}",
            f"{r['frequency']:.2f} ± {r['frequency_sd']:.2f}", f"{r['model_frequency']:.2f}",
        )  # fmt: skip
    out.print(table)
    ranked = Table("cause", "values", "fitted", "unseen", "shrink")
    for c in found.causes:
        values = ", ".join(f"{k} {v:.3g}" for k, v in c.values.items())
        shrink = "not excited" if c.shrink is None else f"{100.0 * c.shrink:.0f} %"
        ranked.add_row(c.name, values, f"{c.train:.3f}", f"{c.after:.3f}", shrink)
    out.print(ranked)
    out.print(
        f"{found.impulses} impulses; the model is off by {found.whole:.3f} 1/s, by {found.before:.3f} on "
        f"those kept from the fits", soft_wrap=True,
    )  # fmt: skip
    if found.speed_gain is not None:
        g, o = found.speed_gain
        out.print(
            f"the speed sensor against the treadmill: {g:.4f} v {o:+.4f} m/s", soft_wrap=True,
        )  # fmt: skip
    out.print(found.sentence, style="bold", soft_wrap=True)
