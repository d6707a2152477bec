"""Loads a command's module only when that command is called: plots and fits need seconds to import."""

from __future__ import annotations

from importlib import import_module
from typing import Any

import typer
from typer.core import TyperCommand, TyperGroup
from typer.main import get_command

COMMANDS: dict[str, tuple[str, str]] = {
    "demo": ("demo:demo", "Ride a simulated rig for a minute: no hardware, no root, no server."),
    "run": (
        "rig:run",
        "Run a rig: the daemon, both processes, until Ctrl-C or SIGTERM, which park the rig first.",
    ),
    "simulate": (
        "rig:simulate",
        "Be the rig: plant, drives and IMU answer on a bus as the real ones would, until Ctrl-C.",
    ),
    "command": (
        "client:command",
        "Give a running rig a command and say what it answered. Exit code 1 if it refused.",
    ),
    "watch": (
        "client:watch",
        "Watch a running rig: state, pose, actuators, tracking error, slots, lateness, events.",
    ),
    "cue": ("cue:app", "Motion cues: make them of a measured ride, stream them to a running rig."),
    "runs": ("runs:app", "Recordings: list, show, report, export, repair, import."),
    "replay": (
        "replay:replay",
        "Feed a recording through the control code: does every frame come out the same?",
    ),
    "check": (
        "check:check",
        "Look at all that a rig needs of this PC, its bus and drives: what is wrong, and how to mend "
        "it.",
    ),
    "latency": (
        "latency:latency",
        "Measure how late a loop like the daemon's wakes on this PC, beside the limits that matter.",
    ),
    "sniff": (
        "sniff:sniff",
        "Show what is said on a bus, decoded, with statistics at the end. Cannot transmit: the kernel"
        " refuses.",
    ),
    "service": ("service:app", "The daemon as a systemd service: install, uninstall, status."),
    "config": ("config:app", "Rig files: everything about a rig in one TOML file."),
    "rig": ("workspace:app", "A rig's mechanism: where it can go."),
    "drive": (
        "drive:app",
        "Commission single drives, of either family: who is there, read, write, home, jog. While a "
        "daemon runs the rig, info, read and write go through it, the others wait until it has ended;"
        " everything passes the gate.",
    ),
    "experiment": (
        "experiment:app",
        "Experiments: design within a rig's limits, play, record. `hil experiment RIG KIND --help`.",
    ),
    "identify": (
        "identify:app",
        "What a rig's parameters are: from runs, with intervals, and what the data cannot tell.",
    ),
    "reproduce": (
        "reproduce:app",
        "The papers again: their experiments on the simulated rigs, as one page beside what they "
        "show.",
    ),
    "gap": (
        "gap:app",
        "The gap between a rig and its twin: where it stands, which effect makes it, how far it "
        "shrinks.",
    ),
    "bicycle": (
        "bicycle:app",
        "An instrumented bicycle: check its file, simulate, record, calibrate, analyse a ride.",
    ),
}
"""Name of each command: module in hil.cli and the function or typer app in it; what `hil --help` says of it,
which is how that begins (a test compares). In the order of `--help`."""


class LazyGroup(TyperGroup):
    """The commands of `COMMANDS`: their names and what they are for, until one of them is called."""

    def list_commands(self, ctx: Any) -> list[str]:
        """Names, in the order of the table."""
        return list(COMMANDS)

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """What `hil --help` says of the command of that name; None if there is none."""
        if cmd_name not in COMMANDS:
            return None
        return TyperCommand(cmd_name, help=COMMANDS[cmd_name][1], rich_markup_mode="markdown")

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """The command that is called, whole."""
        name, command, rest = super().resolve_command(ctx, args)
        return name, command and loaded(str(command.name)), rest


def loaded(name: str) -> Any:
    """The command of that name, with all that it imports."""
    module, _, attribute = COMMANDS[name][0].partition(":")
    found = getattr(import_module(f"hil.cli.{module}"), attribute)
    if not isinstance(found, typer.Typer):
        single = typer.Typer(rich_markup_mode="markdown")
        single.command(name)(found)
        found = single
    found._add_completion = False  # `hil` itself offers it; a group of its own is none
    command = get_command(found)
    command.name = name
    return command
