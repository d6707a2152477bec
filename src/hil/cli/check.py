"""`hil check`: what is wrong with this PC, its bus and its drives, and how to mend it."""

from __future__ import annotations

from dataclasses import asdict
from typing import Annotated

import typer

from hil.cli.console import JsonFlag, RigArgument, err, out, write_json
from hil.cli.options import CanOption, ListenOption, RunsOption, profiles_of, rig_with
from hil.daemon.check import Finding, Probe, check_rig
from hil.errors import ConfigError

_STYLES = {"ok": "green", "warn": "yellow", "fault": "bold red"}


def check(
    rig: RigArgument,
    can: CanOption = None,
    listen: ListenOption = None,
    runs: RunsOption = None,
    ask: Annotated[
        bool, typer.Option("--ask", help="Read one parameter of each drive. Moves nothing.")
    ] = False,
    drives: Annotated[
        bool,
        typer.Option(
            "--drives", help="Prepare the drives as for arming, watchdogs and all; power off."
        ),
    ] = False,
    seconds: Annotated[
        float, typer.Option(help="How long to listen to the bus.", min=0.2, max=60.0)
    ] = 0.6,
    json: JsonFlag = False,
) -> None:
    """Look at all that a rig needs of this PC, its bus and drives: what is wrong, and how to mend it.

    Without --ask or --drives the bus is only listened to. Exit code 1 if there is a fault.
    """
    try:
        settings, _ = rig_with(rig, can=can, listen=listen, runs=runs)
        profiles = profiles_of(settings, rig)
    except ConfigError as error:
        found = [Finding("fault", "rig file", line) for line in str(error).splitlines()]
    else:
        with err.status("checking"):
            found = check_rig(settings, profiles, Probe(seconds, ask, drives))
    if json:
        write_json({"ok": not _is_bad(found), "findings": [asdict(f) for f in found]})
    else:
        _show(found)
    if _is_bad(found):
        raise typer.Exit(1)


def _show(found: list[Finding]) -> None:
    for f in found:
        out.print(f"{f.level:<5}", style=_STYLES[f.level], end=" ")
        out.print(f"{f.topic:<10} {f.text}", soft_wrap=True)
        if f.remedy:
            out.print(f"{'':17}→ {f.remedy}", soft_wrap=True)
    faults = sum(f.level == "fault" for f in found)
    warnings = sum(f.level == "warn" for f in found)
    out.print(f"{faults} faults, {warnings} warnings")


def _is_bad(found: list[Finding]) -> bool:
    return any(f.level == "fault" for f in found)
