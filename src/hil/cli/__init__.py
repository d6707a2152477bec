"""The command line `hil`: one module a group of commands; errors are one sentence and exit code 2."""

from hil.cli.app import main

__all__ = ["main"]
