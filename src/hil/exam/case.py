"""A case on disk: run folders and nominal rig here, the sealed answer there, and nothing between them.

cases/<id>/rig.toml                the nominal rig
cases/<id>/run1/run.toml, ...      run folders; role = "reference" for a healthy record
answers/<id>/answer.json           what it was; its SHA-256 (canonical JSON) stands in each run.toml
"""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any, Final

from hil.config import AnyRig, Effect
from hil.configfile import parse_any_rig, read_toml, rig_toml
from hil.errors import ConfigError, RunError
from hil.exam.world import Outside
from hil.files import whole_folder, write_whole
from hil.runs import Run, load_run
from hil.runs.folder import RUN_TOML, Payload, RunMeta, read_meta, run_mode, write_meta
from hil.runs.jsonfile import read_json

ANSWER: Final = "answer.json"
RIG: Final = "rig.toml"
EPOCH: Final = datetime(2026, 1, 1, tzinfo=UTC)


def seal(answer: Any) -> str:
    """SHA-256 of an answer as canonical JSON: sorted keys, no spaces, UTF-8."""
    text = json.dumps(answer, sort_keys=True, separators=(",", ":"), ensure_ascii=False)
    return hashlib.sha256(text.encode()).hexdigest()


def answer_of(kind: str, effects: Sequence[Effect], outside: Sequence[Outside]) -> dict[str, Any]:
    """What every answer begins with: the verdict that is right, and what the case holds."""
    return {
        "verdict": {"none": "no_gap", "outside": "unknown"}.get(kind, "identified"),
        "effects": [
            {"effect": e.effect, "location": e.location, "parameters": e.parameters}
            for e in effects
        ],
        "outside": [
            {"kind": o.kind, "location": o.location, "parameters": o.parameters} for o in outside
        ],
        "kind": kind,
    }


@dataclass(frozen=True, slots=True)
class Case:
    """One case as a diagnosis may see it."""

    id: str
    rig: AnyRig
    runs: tuple[Run, ...]
    references: tuple[Run, ...]


def name_pattern(only: str) -> re.Pattern[str]:
    """What case names are searched for; ConfigError where it is no regular expression."""
    try:
        return re.compile(only)
    except re.error as error:
        raise ConfigError(f"{only!r} is no pattern (regex): {error}") from error


def case_folders(cases: Path) -> list[Path]:
    """Every case below `cases` (or `cases/cases`), by name; RunError where there is none."""
    inner = cases / "cases"
    root = inner if inner.is_dir() else cases
    if not root.is_dir():
        raise RunError(f"{cases}: no such folder")
    found = sorted(p.parent for p in root.glob(f"*/{RIG}") if not p.parent.name.startswith("."))
    if not found:
        raise RunError(
            f"{root}: holds no case; a case is a folder with {RIG} and run folders (`hil gap exam make` "
            "makes some)"
        )
    return found


def load_case(folder: Path) -> Case:
    """Read a case; RunError or ConfigError names what is wrong."""
    rig = parse_any_rig(read_toml(folder / RIG), str(folder / RIG))
    runs = [load_run(p.parent, rig) for p in sorted(folder.glob(f"*/{RUN_TOML}"))]
    told = tuple(r for r in runs if r.meta.role == "diagnose")
    if not told:
        raise RunError(f"{folder}: holds no run to diagnose")
    return Case(folder.name, rig, told, tuple(r for r in runs if r.meta.role == "reference"))


def seals_of(folder: Path) -> set[str]:
    """The seals that the run folders of a case carry."""
    metas = [read_meta(p.parent) for p in sorted(folder.glob(f"*/{RUN_TOML}"))]
    return {m.answer_sha256 for m in metas if m.answer_sha256}


def read_answer(path: Path) -> dict[str, Any]:
    """An answer file; RunError where it is none."""
    answer = read_json(path)
    if not isinstance(answer, dict) or "verdict" not in answer:
        raise RunError(f'{path}: is no answer: it needs "verdict" and "effects"')
    return answer


def write_case(
    case: str,
    rig: AnyRig,
    tables: Sequence[tuple[Any, str, Payload | None]],
    answer: dict[str, Any],
    number: int,
    out: Path,
) -> None:
    """Write case `number` and seal its answer; `tables`: each run's table, role and payload.

    RunError where the disk refuses or the case is there already: then it is not made, and an answer that
    is there stays.
    """
    folder = out / "cases" / case
    try:
        with whole_folder(folder) as fresh:
            _write_runs(fresh, rig, tables, answer, number)
            text = rig_toml(rig, "the nominal rig of an exam case")
            (fresh / RIG).write_text(text, encoding="utf-8")
            kept = out / "answers" / case
            kept.mkdir(parents=True, exist_ok=True)
            write_whole(kept / ANSWER, json.dumps(answer, indent=1, ensure_ascii=False) + "\n")
    except OSError as error:
        raise RunError(f"{folder}: cannot be written: {error.strerror or error}") from error


def _write_runs(
    fresh: Path,
    rig: AnyRig,
    tables: Sequence[tuple[Any, str, Payload | None]],
    answer: dict[str, Any],
    number: int,
) -> None:
    for k, (table, role, payload) in enumerate(tables, start=1):
        folder = fresh / f"run{k}"
        folder.mkdir()
        meta = RunMeta.model_validate(
            {
                "rig": rig.name,
                "mode": run_mode(rig),
                "started": EPOCH + timedelta(hours=number, minutes=5 * k),
                "role": role,
                "answer_sha256": seal(answer),
                "payload": payload,
            }
        )
        write_meta(folder, meta)
        table.to_parquet(folder / "signals.parquet", index=False, compression="zstd")
