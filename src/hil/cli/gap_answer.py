"""The answer file of `hil gap diagnose`, as other commands read it."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import msgspec

from hil.errors import RunError
from hil.gap.apply import FORMAT
from hil.runs.jsonfile import read_json


class _Parameter(msgspec.Struct):
    value: float | None
    ci: tuple[float | None, float | None] | None = None
    unit: str = ""


class _Cause(msgspec.Struct):
    effect: str
    location: str
    probability: float
    parameters: dict[str, _Parameter]


class _Gap(msgspec.Struct):
    signals: dict[str, Any] = {}
    shrink: float | None = None
    shrink_ci: tuple[float, float] | None = None


class _Answer(msgspec.Struct):
    """What `hil gap apply` and `hil gap next` need of an answer."""

    rig: str
    verdict: str
    gap: _Gap
    causes: list[_Cause]
    effects: list[_Cause]
    runs: list[str] = []


def read_answer_file(path: Path) -> dict[str, Any]:
    """The answer at `path` as plain tables, with the infinity that JSON has no number for.

    RunError where it cannot be read, or is no answer.
    """
    tables: Any = read_json(path)
    if not isinstance(tables, dict) or tables.get("format") != FORMAT:
        raise RunError(f"{path}: is no diagnosis: its format is not {FORMAT}")
    try:
        msgspec.convert(tables, _Answer)
    except msgspec.ValidationError as error:
        raise RunError(f"{path}: is no diagnosis that could be read: {error}") from error
    for cause in (*tables["causes"], *tables["effects"]):
        for p in cause["parameters"].values():
            p["value"] = math.inf if p["value"] is None else p["value"]
            ends = p.get("ci") or (p["value"], p["value"])
            p["ci"] = [math.inf if end is None else end for end in ends]
            p.setdefault("unit", "")
    return tables
