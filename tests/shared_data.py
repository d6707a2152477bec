"""Finds the measured data and reference tables that lie beside a checkout and do not ship with it."""

from __future__ import annotations

from pathlib import Path

import pytest

SHARED = Path(__file__).parents[2] / "shared"


def shared(name: str) -> Path:
    """Path of `name` among the shared files; the test that asks is skipped where it is absent."""
    path = SHARED / name
    if not path.exists():
        pytest.skip(f"needs {name}, which does not ship with the project")
    return path
