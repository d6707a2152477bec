"""Reads a JSON file, and says what is wrong with one that is none."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from hil.errors import RunError


def read_json(path: Path) -> Any:
    """What stands in the file; RunError where it cannot be read or is no JSON."""
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise RunError(f"{path}: cannot be read: {error.strerror}") from error
    except ValueError as error:
        raise RunError(f"{path}: is no JSON: {error}") from error
