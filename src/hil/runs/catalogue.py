"""What lies in a folder of runs, and what a run holds."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from hil.errors import RunError
from hil.runs.folder import RECORDING, RUN_TOML, STOPPED, counted, is_being_recorded, read_meta
from hil.runs.reader import Run


@dataclass(frozen=True, slots=True)
class RunInfo:
    """One run of a folder, as `run.toml` tells it; `trouble` where that cannot be read."""

    path: Path
    rig: str = ""
    mode: str = ""
    started: datetime | None = None
    duration_s: float | None = None
    """From start to end; None where the recorder did not live to write it."""
    note: str = ""
    size_bytes: int = 0
    trouble: str | None = None


@dataclass(frozen=True, slots=True)
class SignalInfo:
    """One signal of a run."""

    name: str
    samples: int
    rate_hz: float
    """Samples a second, from the median distance of two."""
    longest_gap_s: float
    lowest: float
    highest: float


def list_runs(folder: Path) -> list[RunInfo]:
    """The runs in `folder`, newest first; none where it does not exist. Reads no recordings.

    Runs that started together (all simulated ones do) stand in the order of their names; last come those
    that do not say when they started.
    """
    if not folder.is_dir():
        return []
    runs = [_info(path.parent) for path in folder.glob(f"*/{RUN_TOML}")]
    return sorted(runs, key=_age, reverse=True)


def signal_infos(run: Run) -> list[SignalInfo]:
    """Samples, rate, longest gap and range of every signal."""
    t = run.table["t"].to_numpy()
    infos = []
    for name in run.table.columns.drop("t"):
        values = run.table[name].to_numpy()
        there = ~np.isnan(values)
        steps = np.diff(t[there])
        infos.append(
            SignalInfo(
                str(name),
                int(there.sum()),
                float(1.0 / np.median(steps)) if steps.size else 0.0,
                float(steps.max()) if steps.size else 0.0,
                float(values[there].min()),
                float(values[there].max()),
            )
        )
    return infos


def _age(info: RunInfo) -> tuple[datetime, tuple[tuple[int, str], ...]]:
    return info.started or datetime.min.replace(tzinfo=UTC), counted(info.path)


def _info(folder: Path) -> RunInfo:
    size = sum(p.stat().st_size for p in folder.iterdir() if p.is_file())
    try:
        meta = read_meta(folder)
    except RunError as error:
        return RunInfo(folder, size_bytes=size, trouble=str(error))
    ended, reason = None, ""
    if meta.recording is not None:
        ended, reason = meta.recording.ended, meta.recording.end_reason
    duration = (
        (ended - meta.started).total_seconds() if ended is not None and meta.started else None
    )
    trouble = reason if reason.startswith(STOPPED) else None
    if meta.recording is not None and ended is None and (folder / RECORDING).is_file():
        live = is_being_recorded(folder / RECORDING)
        trouble = "is being recorded" if live else "was never ended: its recorder was killed"
    return RunInfo(folder, meta.rig, meta.mode, meta.started, duration, meta.note, size, trouble)
