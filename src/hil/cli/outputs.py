"""Files that a command writes when it has computed: asked for before, and none lost for another's fault."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from hil.cli.console import err
from hil.errors import HilError, RunError

Write = Callable[[Path], object]
JsonFile = Annotated[
    Path | None, typer.Option("--json", help="Write the answer as JSON; - for stdout.")
]
Page = Annotated[Path | None, typer.Option("--report", help="Write a page with pictures (HTML).")]


@dataclass(frozen=True, slots=True)
class Outputs:
    """Where a command's answer goes: into JSON (`-`: to stdout, in the text's place), onto a page."""

    json: Path | None
    page: Path | None

    @property
    def json_file(self) -> Path | None:
        """None where JSON is not asked for, or goes to stdout."""
        return None if self.json is None or str(self.json) == "-" else self.json

    def make_ready(self) -> None:
        """Make the folders of both; RunError names each path that cannot be written."""
        make_ready(self.json_file, self.page)

    def give(self, answer: Callable[[], bytes], draw: Write, show: Callable[[], None]) -> None:
        """Write the JSON `answer` and `draw` the page, then `show` the text: whoever reads it may be gone.

        RunError as `write_all`.
        """
        writes: dict[Path, Write] = {}
        if self.json_file is not None:
            writes[self.json_file] = lambda path: path.write_bytes(answer() + b"\n")
        if self.page is not None:
            writes[self.page] = draw
        try:
            write_all(writes)
        finally:
            if self.json is not None and self.json_file is None:
                typer.echo(answer().decode())
            else:
                show()
        if self.page is not None:
            err.print(f"page: {self.page}", soft_wrap=True)


def make_ready(*paths: Path | None) -> None:
    """Make the folders that `paths` lie in; RunError names each path that cannot be written."""
    _refuse([f for path in paths if path is not None if (f := _fault(path))])


def make_ready_anew(*paths: Path | None) -> None:
    """As `make_ready`, for what never overwrites: RunError also names each path where something stands."""
    wanted = [path for path in paths if path is not None]
    there = [f"{p}: exists already; name another file with --out" for p in wanted if p.exists()]
    _refuse(there or [f for p in wanted if (f := _fault(p))])


def write_all(writes: Mapping[Path, Write]) -> None:
    """Write every file, also where one before it fails; RunError names each that failed."""
    faults = []
    for path, write in writes.items():
        try:
            write(path)
        except OSError as error:
            faults.append(f"{path}: cannot be written: {error.strerror}")
        except HilError as error:
            faults.append(str(error))
    _refuse(faults)


def _refuse(faults: Sequence[str]) -> None:
    if faults:
        raise RunError("\n".join(faults))


def _fault(path: Path) -> str | None:
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except (FileExistsError, NotADirectoryError):
        return f"{path}: cannot be written: {path.parent} is no folder, but a file or in one"
    except OSError as error:
        return f"{path}: cannot be written: {path.parent}: {error.strerror}"
    if path.is_dir():
        return f"{path}: cannot be written: is a folder, not a file"
    if not os.access(path if path.exists() else path.parent, os.W_OK):
        return f"{path}: cannot be written: permission denied"
    return None
