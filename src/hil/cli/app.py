"""The command `hil`: its commands stand in `hil.cli.lazy`; here errors become sentences."""

from __future__ import annotations

import errno
import os
import signal
import sys
from typing import Final

import typer

from hil import __version__
from hil.cli.console import complain
from hil.cli.lazy import LazyGroup
from hil.errors import HilError

UNTAKEN: Final = frozenset({errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO, errno.EPIPE})
"""How writing to what is open already fails."""

INTERRUPTED: Final = 130
"""Exit code of what was told to end; hild.service takes it for success."""

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

    Also 1 where the output is not taken: a full disk behind stdout.

    SIGTERM interrupts as Ctrl-C does: what was begun is cleared away, what was finished stays.
    """
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        _run()
    except HilError as error:
        complain(str(error))
        sys.exit(2)
    except KeyboardInterrupt:
        sys.exit(INTERRUPTED)
    except OSError as error:
        if error.errno not in UNTAKEN:
            raise
        if error.errno != errno.EPIPE:  # a reader who has seen enough
            complain(f"the output cannot be written: {error.strerror}")
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # Python's end flushes again
        sys.exit(1)


def _run() -> None:
    try:
        app()
    except SystemExit:
        sys.stdout.flush()
        raise
