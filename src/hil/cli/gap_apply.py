"""`hil gap apply`: what was diagnosed goes into a rig file."""

from __future__ import annotations

import tomllib
from datetime import date
from pathlib import Path
from typing import Annotated, Any

import typer

from hil.cli.console import err, out
from hil.cli.gap_answer import read_answer_file
from hil.configfile import find_rig_file, load_any_rig, parse_any_rig, toml_text, write_rig_file
from hil.effectlines import checked
from hil.errors import ConfigError
from hil.gap.apply import alarms, applied_text, chosen_causes, habits_of
from hil.units import with_unit


def apply(
    diagnosis: Annotated[
        Path, typer.Argument(metavar="DIAGNOSIS", help="From `hil gap diagnose --json`.")
    ],
    rig: Annotated[str, typer.Option("--rig", help="Rig file that was diagnosed, or its name.")],
    to: Annotated[Path, typer.Option("--out", help="The new rig file.")],
    pick: Annotated[
        list[str] | None,
        typer.Option(
            "--pick",
            metavar="LOCATION.EFFECT",
            help="A cause to apply instead of the verdict's set; may be given again.",
        ),
    ] = None,
) -> None:
    """Write the diagnosed effects into a rig file, for twin, simulated rig and feed-forward.

    Comments and order of the file stay; each effect says which runs it comes from, when, and how far the gap
    shrank. A verdict of `unknown` or `ambiguous` is applied only with --pick. What the rig was found
    to have or do unlike its file stands in the new one, too.
    """
    answer = read_answer_file(diagnosis)
    path = find_rig_file(rig)
    picked = tuple(pick or ())
    settings = checked(load_any_rig(rig), rig)
    try:
        text = applied_text(
            toml_text(path), answer, when=date.today().isoformat(),
            source=diagnosis.name, pick=picked,
        )  # fmt: skip
    except ConfigError as error:
        raise ConfigError(f"{diagnosis}: {error}") from error
    write_rig_file(to, text)
    for cause in (causes := chosen_causes(answer, settings, picked)):
        values = ", ".join(
            with_unit(f"{name} {p['value']:.6g}", p["unit"])
            for name, p in cause["parameters"].items()
        )
        out.print(
            f"{cause['effect'].replace('_', ' ')} at {cause['location']}: {values}", soft_wrap=True,
        )  # fmt: skip
    for habit in habits_of(answer):
        out.print(f"{habit['subject']}: {habit['text']}", soft_wrap=True)
    for alarm in alarms(causes):
        err.print(f"alarm: {alarm}", style="yellow", soft_wrap=True)
    if any(getattr(a, "friction_ff", 0.0) for a in _actuators(text)):
        err.print(
            "drives with friction pre-control feed it forward once they are set up by the new file",
            soft_wrap=True,
        )  # fmt: skip
    err.print(f"rig file: {to}", soft_wrap=True)


def _actuators(text: str) -> tuple[Any, ...]:
    return tuple(getattr(parse_any_rig(tomllib.loads(text), "rig file"), "actuators", ()))
