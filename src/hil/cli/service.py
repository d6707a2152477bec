"""`hil service`: the daemon as a systemd service of this PC."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from hil.cli.console import out
from hil.daemon import service

app = typer.Typer(
    help="The daemon as a systemd service: install, uninstall, status.", no_args_is_help=True
)

RootOption = Annotated[
    Path, typer.Option("--root", help="Install below this folder, as for an image of a rig PC.")
]


@app.command()
def install(
    root: RootOption = Path("/"),
    rig: Annotated[
        str | None,
        typer.Option(
            "--rig", help="Rig file to install as /etc/hil/rig.toml; the old one is kept."
        ),
    ] = None,
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="Only say what would be done.")
    ] = False,
) -> None:
    """Install hild.service, the CAN interface's unit, user, folders and rig file. Starts nothing."""
    lines = service.install(root, rig, dry_run=dry_run)
    _say(lines)
    if any(line.startswith("failed") for line in lines):
        raise typer.Exit(1)


@app.command()
def uninstall(root: RootOption = Path("/")) -> None:
    """Stop and remove the service. Rig file, recordings and user stay."""
    _say(service.uninstall(root))


@app.command()
def status(root: RootOption = Path("/")) -> None:
    """Say what is installed, whether it is what this hil would install, and whether it runs."""
    _say(service.status(root))


def _say(lines: list[str]) -> None:
    for line in lines:
        out.print(line, soft_wrap=True)
