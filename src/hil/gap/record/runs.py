"""Runs and rigs from whatever the caller has: Run objects, frames as run folders hold them, paths, names."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Final

import numpy as np
import pandas as pd

from hil.config import AnyRig, BicycleFile, RigFile
from hil.configfile import load_any_rig
from hil.effectlines import checked
from hil.errors import RunError
from hil.runs import Run, RunMeta, load_run
from hil.runs.table import check_table

SomeRun = Run | pd.DataFrame | str | Path
SomeRuns = SomeRun | Iterable[SomeRun]

SLOWEST_S: Final = 0.5
MANY: Final = 200
"""So many samples of a signal, further apart than SLOWEST_S each, have a `t` that is not in seconds."""


def as_runs(runs: SomeRuns, rig: AnyRig) -> list[Run]:
    """Every run as a checked Run of `rig`; a frame with force setpoints is one of mode "force".

    RunError names file or frame, column and row of what is no run; TypeError what is nothing of the sort.
    """
    alone = isinstance(runs, Run | pd.DataFrame | str | Path)
    if not alone and not isinstance(runs, Iterable):
        raise TypeError(_expected("runs", runs))
    given = [runs] if isinstance(runs, Run | pd.DataFrame | str | Path) else list(runs)
    loaded = [_as_run(r, rig, k) for k, r in enumerate(given, 1)]
    if isinstance(rig, RigFile):
        for run in loaded:
            _check_time(run)
    return loaded


def require_apart(runs: Sequence[Run], references: Sequence[Run] = ()) -> None:
    """RunError where a record comes twice: its samples would count twice, and as a reference of itself it
    would hide whatever is in it."""
    every = [(run, "run") for run in runs] + [(run, "reference") for run in references]
    for k, (run, role) in enumerate(every):
        for other, its in every[:k]:
            if run.table.equals(other.table):
                what = "is given twice" if role == its else "is its own reference"
                raise RunError(f"{run.path}: {what}: it holds the same samples as {other.path}")


def as_rig(rig: AnyRig | str | Path) -> AnyRig:
    """`rig` itself, or read of the file of that path or name; TypeError where it is nothing of the sort."""
    if isinstance(rig, str | Path):
        return checked(load_any_rig(rig), rig)
    if isinstance(rig, RigFile | BicycleFile):
        return rig
    raise TypeError(
        f"rig is a {type(rig).__name__}: give a rig that was loaded (hil.configfile.load_rig), the path of "
        "a rig file, or the name of one that comes with hil"
    )


def _as_run(run: SomeRun, rig: AnyRig, number: int) -> Run:
    if isinstance(run, Run):
        return run
    if isinstance(run, str | Path):
        return load_run(run, rig)
    if isinstance(run, pd.DataFrame):
        return _from_frame(run, rig, number)
    raise TypeError(_expected(f"run {number}", run))


def _expected(what: str, given: object) -> str:
    return (
        f"{what}: is a {type(given).__name__}; give a Run, a pandas frame with t and one column a signal, "
        "or the path of a run folder"
    )


def _from_frame(frame: pd.DataFrame, rig: AnyRig, number: int) -> Run:
    name = f"frame {number}"
    table = check_table(frame, name, rig)
    states = pd.DataFrame({"t": []})
    if isinstance(rig, BicycleFile):
        ride = RunMeta(rig=rig.name, mode="ride")
        return Run(Path(name), ride, None, table, states, (), bicycle=rig)
    columns = [str(c) for c in table.columns]
    is_force = any(c.endswith(".force_setpoint") for c in columns)
    is_force &= not any(c.endswith(".setpoint") for c in columns)
    meta = RunMeta(rig=rig.name, mode="force" if is_force else "position")
    return Run(Path(name), meta, rig, table, states, ())


def _check_time(run: Run) -> None:
    """RunError where every signal comes so slowly that `t` must be in ms, us or ns."""
    t = run.table["t"].to_numpy(dtype=float)
    stamps = [t[run.table[c].notna().to_numpy()] for c in run.table.columns if c != "t"]
    most = max(stamps, key=len)
    usual = (
        min(float(np.median(np.diff(s))) for s in stamps if len(s) > 1) if len(most) > 1 else 0.0
    )
    if len(most) < MANY or usual <= SLOWEST_S:
        return
    raise RunError(
        f"{run.path}: column t: {len(most)} samples, one each {usual:.4g} s, are no log of motion: t is in "
        "seconds; is it in ms, us or ns here? divide it by 1e3, 1e6 or 1e9"
    )
