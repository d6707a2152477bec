"""Files and folders that are there whole or not at all, though a disk fills or the writer is killed."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


def write_whole(path: Path, text: str | bytes) -> None:
    """Write `path` (text as UTF-8), in place of what stood there. OSError: that stands there still."""
    fresh = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        fresh.write_bytes(text.encode() if isinstance(text, str) else text)
        fresh.replace(path)
    except BaseException:
        fresh.unlink(missing_ok=True)
        raise


def is_taken(folder: Path) -> bool:
    """Whether anything stands at `folder` but an empty folder."""
    return folder.exists() and (not folder.is_dir() or any(folder.iterdir()))


@contextmanager
def whole_folder(folder: Path) -> Iterator[Path]:
    """A folder to fill, which becomes `folder` once that is done; where it fails, there is nothing.

    FileExistsError where `folder` is taken.
    """
    if is_taken(folder):
        raise FileExistsError(f"{folder}: exists already")
    fresh = folder.with_name(f".{folder.name}.part")
    shutil.rmtree(fresh, ignore_errors=True)  # of a writer that was killed
    fresh.mkdir(parents=True)
    try:
        yield fresh
        fresh.replace(folder)
    except BaseException:
        shutil.rmtree(fresh, ignore_errors=True)
        raise
