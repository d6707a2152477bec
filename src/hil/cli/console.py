"""Where commands write: results to stdout, complaints to stderr, JSON where a script asks for it."""

from __future__ import annotations

from typing import Annotated, Any

import msgspec
import typer
from rich.console import Console

# Notes, paths and names are what people wrote: brackets and colons in them are no markup and no pictures.
out = Console(highlight=False, markup=False, emoji=False)
err = Console(stderr=True, highlight=False, markup=False, emoji=False)

JsonFlag = Annotated[bool, typer.Option("--json", help="Write JSON for a script instead of text.")]
RigArgument = Annotated[
    str,
    typer.Argument(
        metavar="RIG",
        help="A rig file, or the bare name of one that comes with hil: motorcycle, axis.",
    ),
]


def complain(text: str) -> None:
    """Say what is wrong, on stderr, in red where that shows."""
    for line in text.splitlines():
        err.print(line, style="red", soft_wrap=True)


def write_json(value: Any) -> None:
    """`value` as JSON on stdout."""
    typer.echo(msgspec.json.format(msgspec.json.encode(value), indent=2).decode())
