"""Cue trajectories as files: CSV with `t` (s) and one column a coordinate, in m or rad.

Comment lines before the header say the format, the rig and where the motion comes from:

    # hil-cue/1
    # rig: motorcycle
    # from ride.log.gz, SHA-256 ...
    t,yaw,pitch,roll
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
import pandas as pd

from hil.control.trajectory import CueTrajectory
from hil.errors import RunError
from hil.files import write_whole
from hil.runs.csvfile import csv_table
from hil.runs.table import check_increasing, finite_numbers

FORMAT: Final = "hil-cue/1"


@dataclass(frozen=True, slots=True)
class CueFile:
    """What a cue file holds."""

    trajectory: CueTrajectory
    rig: str
    """Name of the rig that it was made for; empty where the file does not say."""
    notes: tuple[str, ...]


def write_cue_file(
    path: Path, trajectory: CueTrajectory, rig: str, notes: Sequence[str] = ()
) -> None:
    """Write `trajectory` for the rig of that name; RunError where the disk does not take it."""
    lines = [FORMAT, f"rig: {rig}", *(" ".join(note.split()) for note in notes)]
    head = "".join(f"# {line}\n" for line in lines)
    table = pd.DataFrame(trajectory.poses, columns=list(trajectory.coordinates))
    table.insert(0, "t", trajectory.t_s)
    try:
        write_whole(path, head + table.to_csv(index=False, float_format="%.9g"))
    except OSError as error:
        raise RunError(f"{path}: cannot be written: {error.strerror}") from error


def read_cue_file(path: Path) -> CueFile:
    """Read a cue file; RunError names file, column and row.

    Comments are not needed: any CSV with `t` and coordinates will do.
    """
    if not path.is_file():
        raise RunError(f"{path}: no such file")
    try:
        text = path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError as error:
        raise RunError(f"{path}: is no cue file: {error}") from error
    comments = _comments(text)
    table = csv_table(path, comment="#")
    if comments and comments[0].startswith("hil-cue/") and comments[0] != FORMAT:
        raise RunError(f"{path}: format is {comments[0]!r}, hil reads {FORMAT!r}")
    if "t" not in table.columns:
        raise RunError(f"{path}: has no column 't' (s)")
    columns = {str(c): finite_numbers(table[c], str(path), str(c)) for c in table.columns}
    for name, values in columns.items():
        empty = np.flatnonzero(np.isnan(values))
        if empty.size:
            raise RunError(f"{path}: column {name}, row {int(empty[0]) + 1}: is empty")
    t = columns.pop("t")
    check_increasing(t, f"{path}: column t", "row", strictly=True)
    if not columns or len(t) < 2:
        raise RunError(
            f"{path}: holds {len(t)} poses of {len(columns)} coordinates, that is no cue"
        )
    rigs = [line.removeprefix("rig:").strip() for line in comments if line.startswith("rig:")]
    notes = [line for line in comments if line != FORMAT and not line.startswith("rig:")]
    poses = np.column_stack(list(columns.values()))
    return CueFile(CueTrajectory(tuple(columns), t, poses), rigs[0] if rigs else "", tuple(notes))


def _comments(text: str) -> list[str]:
    lines = (line.strip() for line in text.splitlines())
    return [line.removeprefix("#").strip() for line in lines if line.startswith("#")]
