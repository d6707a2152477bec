"""Runs from whatever the caller has: Run objects, or pandas frames as run folders hold them."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import pandas as pd

from hil.config import RigFile
from hil.runs import Run, RunMeta
from hil.runs.table import check_table


def as_runs(runs: Run | pd.DataFrame | Iterable[Run | pd.DataFrame], rig: RigFile) -> list[Run]:
    """Every run as a checked Run of `rig`; a frame with force setpoints is one of mode "force".

    RunError names column and row of a frame that is no run.
    """
    given = [runs] if isinstance(runs, Run | pd.DataFrame) else list(runs)
    return [r if isinstance(r, Run) else _from_frame(r, rig, k) for k, r in enumerate(given, 1)]


def _from_frame(frame: pd.DataFrame, rig: RigFile, number: int) -> Run:
    name = f"frame {number}"
    table = check_table(frame, name, rig)
    columns = [str(c) for c in table.columns]
    is_force = any(c.endswith(".force_setpoint") for c in columns)
    is_force &= not any(c.endswith(".setpoint") for c in columns)
    meta = RunMeta(rig=rig.name, mode="force" if is_force else "position")
    return Run(Path(name), meta, rig, table, pd.DataFrame({"t": []}), ())
