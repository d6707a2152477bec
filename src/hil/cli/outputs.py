"""Files that a command writes when it has computed: asked for before, and none lost for another's fault."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from pathlib import Path

from hil.errors import RunError

Write = Callable[[Path], object]


def make_ready(*paths: Path | None) -> None:
    """Make the folders that `paths` lie in; RunError names each path that cannot be written."""
    faults = [f for path in paths if path is not None if (f := _fault(path))]
    if faults:
        raise RunError("\n".join(faults))


def write_all(writes: Mapping[Path, Write]) -> None:
    """Write every file, also where one before it fails; RunError names each that failed."""
    faults = []
    for path, write in writes.items():
        try:
            write(path)
        except OSError as error:
            faults.append(f"{path}: cannot be written: {error.strerror}")
        except RunError as error:
            faults.append(str(error))
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
