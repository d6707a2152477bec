"""Writes a run as a run folder that anybody's tools read: `run.toml` and one table of signals."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Final, Literal

from hil.errors import RunError
from hil.files import whole_folder
from hil.messages import EventMessage, encode
from hil.runs.folder import (
    CUSTOM_CSV,
    DRIVES,
    EVENTS,
    EXPERIMENT_CSV,
    EXPERIMENT_TOML,
    EXTRA,
    RIG_TOML,
    RunMeta,
    write_meta,
)
from hil.runs.mcapfile import McapSource
from hil.runs.reader import Run

_SIGNALS: Final = {"parquet": "signals.parquet", "csv": "signals.csv"}


def export_run(run: Run, folder: Path, kind: Literal["parquet", "csv"] = "parquet") -> Path:
    """Write `run` into the new `folder` and return it.

    Samples keep their own instants and all their digits; `t` counts from the start of recording.
    RunError where the folder exists and is not empty, or cannot be written.
    """
    try:
        with whole_folder(folder) as fresh:
            _keep(run, fresh)
            if run.events:
                lines = (EventMessage(e.t_s, e.severity, e.name, e.text) for e in run.events)
                (fresh / EVENTS).write_bytes(b"".join(encode(line) + b"\n" for line in lines))
            path = fresh / _SIGNALS[kind]
            if kind == "csv":
                run.table.to_csv(path, index=False)
            else:
                run.table.to_parquet(path, index=False, compression="zstd")
            write_meta(fresh, _from_zero(run.meta))
    except FileExistsError as error:
        raise RunError(f"{folder}: exists already; an export never overwrites") from error
    except OSError as error:
        raise RunError(f"{folder}: cannot be written: {error.strerror or error}") from error
    return folder


def _keep(run: Run, folder: Path) -> None:
    """Copy what the run knows of its rig and its experiment; a bare .mcap file has its rig file inside."""
    if run.path.is_file():
        source = McapSource(run.path)
        next(iter(source), None)  # attachments come before the first message
        if RIG_TOML in source.attachments:
            (folder / RIG_TOML).write_bytes(source.attachments[RIG_TOML])
        return
    for name in (RIG_TOML, EXTRA, EXPERIMENT_TOML, EXPERIMENT_CSV, CUSTOM_CSV):
        if (run.path / name).is_file():
            shutil.copyfile(run.path / name, folder / name)
    if (run.path / DRIVES).is_dir():
        shutil.copytree(run.path / DRIVES, folder / DRIVES)


def _from_zero(meta: RunMeta) -> RunMeta:
    if meta.recording is None:
        return meta
    return meta.model_copy(update={"recording": meta.recording.model_copy(update={"start_s": 0.0})})
