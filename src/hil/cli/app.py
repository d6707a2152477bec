"""The command `hil`: its commands stand in `hil.cli.lazy`; here errors become sentences."""

from __future__ import annotations

import signal
import sys

import typer

from hil import __version__
from hil.cli.console import complain
from hil.cli.lazy import LazyGroup
from hil.errors import HilError

app = typer.Typer(
    name="hil",
    cls=LazyGroup,
    help="Run motion-simulator rigs with servo drives on CAN, record them, and see how they behave.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode="markdown",
    epilog="Start here: `hil demo` rides a simulated motorcycle rig for a minute; no hardware, no root.",
)


@app.callback(invoke_without_command=True)
def _version(
    version: bool = typer.Option(False, "--version", help="Say which hil this is and leave."),
) -> None:
    if version:
        typer.echo(f"hil {__version__}")
        raise typer.Exit


def main() -> None:
    """Entry point: exit code 0 done, 1 done but the answer is no, 2 could not be done, 130 interrupted.

    SIGTERM interrupts as Ctrl-C does: what was begun is cleared away, what was finished stays.
    """
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        app()
    except HilError as error:
        complain(str(error))
        sys.exit(2)
    except KeyboardInterrupt:
        sys.exit(130)
