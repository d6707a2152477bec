"""What an answer is made of, by SHA-256: an answer that is kept counts only for the same."""

from __future__ import annotations

import hashlib
from collections.abc import Collection, Iterable, Mapping
from pathlib import Path
from typing import Any, Final

from hil import __version__
from hil.configfile import find_rig_file
from hil.errors import RunError
from hil.runs.folder import EVENTS, RECORDING, RIG_TOML, RUN_TOML

READ: Final = (RUN_TOML, RIG_TOML, RECORDING, "signals.parquet", "signals.csv", EVENTS)
"""Of a run folder, the files that a diagnosis reads."""
WORDS: Final = {"hil": "hil's version", "rig": "the rig file", "runs": "the runs",
                "references": "the references", "without": "the effects", "seed": "the seed"}  # fmt: skip


def inputs_of(
    rig: str,
    runs: Iterable[str],
    references: Iterable[str],
    without: Collection[str],
    seed: int,
) -> dict[str, Any]:
    """Everything that makes the answer, as plain tables; RunError or ConfigError where a file is missing."""
    return {
        "hil": __version__,
        "rig": _sha256([find_rig_file(rig)]),
        "runs": {path: _of_run(Path(path)) for path in runs},
        "references": {path: _of_run(Path(path)) for path in references},
        "without": sorted(without),
        "seed": seed,
    }


def differing(before: Mapping[str, Any], now: Mapping[str, Any]) -> list[str]:
    """In words, what of `before` is another thing `now`."""
    return [word for key, word in WORDS.items() if before.get(key) != now[key]]


def _of_run(path: Path) -> str:
    if path.name == RECORDING and (path.parent / RUN_TOML).is_file():
        path = path.parent
    if path.is_dir():
        return _sha256([path / name for name in READ if (path / name).is_file()])
    return _sha256([path])


def _sha256(files: Iterable[Path]) -> str:
    whole = hashlib.sha256()
    for path in files:
        try:
            with path.open("rb") as stream:
                digest = hashlib.file_digest(stream, "sha256").hexdigest()
        except OSError as error:
            raise RunError(f"{path}: cannot be read: {error.strerror}") from error
        whole.update(f"{path.name} {digest}\n".encode())
    return whole.hexdigest()
