"""Nothing may be left behind by a test of the bus: no descriptor, no thread, no task."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from pathlib import Path

import pytest


def _descriptors() -> dict[str, str]:
    found = {}
    for entry in Path("/proc/self/fd").iterdir():
        try:
            found[entry.name] = str(entry.readlink())
        except FileNotFoundError:  # the one that listed them
            continue
    return found


@pytest.fixture(autouse=True)
def _nothing_left_behind() -> Iterator[None]:
    before, threads = _descriptors(), set(threading.enumerate())
    yield
    after = _descriptors()
    leaked = {fd: target for fd, target in after.items() if before.get(fd) != target}
    assert not leaked, f"descriptors left open: {leaked}"
    alive = set(threading.enumerate()) - threads
    assert not alive, f"threads left running: {alive}"
