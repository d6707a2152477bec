"""Loads a command's module only when that command is called: plots and fits need seconds to import."""

from __future__ import annotations

from importlib import import_module
from typing import Any

import typer
from typer.core import TyperGroup
from typer.main import get_command

COMMANDS: dict[str, str] = {
    "demo": "demo:demo",
    "run": "rig:run",
    "simulate": "rig:simulate",
    "command": "client:command",
    "watch": "client:watch",
    "cue": "cue:app",
    "runs": "runs:app",
    "replay": "replay:replay",
    "check": "check:check",
    "latency": "latency:latency",
    "sniff": "sniff:sniff",
    "service": "service:app",
    "config": "config:app",
    "rig": "workspace:app",
    "drive": "drive:app",
    "experiment": "experiment:app",
    "identify": "identify:app",
    "reproduce": "reproduce:app",
    "gap": "gap:app",
    "bicycle": "bicycle:app",
}
"""Name of each command: module in hil.cli, and the function or typer app in it. In the order of `--help`."""


class LazyGroup(TyperGroup):
    """The commands of `COMMANDS`; only `hil --help` loads them all."""

    def list_commands(self, ctx: Any) -> list[str]:
        """Names, in the order of the table."""
        return list(COMMANDS)

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """The command of that name, None if there is none."""
        if cmd_name not in COMMANDS:
            return None
        module, _, attribute = COMMANDS[cmd_name].partition(":")
        found = getattr(import_module(f"hil.cli.{module}"), attribute)
        if not isinstance(found, typer.Typer):
            single = typer.Typer(rich_markup_mode="markdown")
            single.command(cmd_name)(found)
            found = single
        found._add_completion = False  # `hil` itself offers it; a group of its own is none
        command = get_command(found)
        command.name = cmd_name
        return command
