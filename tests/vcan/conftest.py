"""The interface as it should be, before and after each test."""

from __future__ import annotations

import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

from .wire import VCAN, ip, require_interface


@pytest.fixture(autouse=True)
def _interface() -> Iterator[None]:
    require_interface()
    yield
    if not Path(f"/sys/class/net/{VCAN}").exists():
        ip("link", "add", VCAN, "type", "vcan")
    subprocess.run(["tc", "qdisc", "del", "dev", VCAN, "root"], stderr=subprocess.DEVNULL)
    ip("link", "set", VCAN, "up")
