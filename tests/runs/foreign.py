"""A motion of the `axis` rig as somebody else's logger would have written it, and maps to bring it in."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd

from hil.runs import Run, load_run
from hil.runs.importing import ImportReport, import_run

DELAY_S = 0.012
RATE_HZ = 500.0
SIGNALS = """
[signals]
"axis.setpoint" = { column = "target", unit = "mm" }
"axis.position" = { column = "actual", unit = "mm" }
"axis.velocity" = { column = "speed", unit = "mm/s" }
"axis.force" = { column = "force", unit = "kN" }
"""
CLOCK = """
[time]
column = "time"
unit = "ms"
"""


def path_m(t: np.ndarray) -> np.ndarray:
    """A motion of no period within the record, m."""
    return 0.06 * np.sin(2.0 * t) + 0.04 * np.sin(5.3 * t + 0.4) + 0.01 * np.sin(13.1 * t + 2.0)


def motion(seconds: float = 8.0) -> pd.DataFrame:
    """ms, mm, mm/s, kN: 135 kg that follow the path, with friction."""
    t = np.arange(int(seconds * RATE_HZ)) / RATE_HZ
    late = t - DELAY_S
    h = 1e-4
    v = (path_m(late + h) - path_m(late - h)) / (2.0 * h)
    a = (path_m(late + h) - 2.0 * path_m(late) + path_m(late - h)) / h**2
    force = 135.0 * a + 120.0 * v + 20.0 * np.sign(v)
    return pd.DataFrame(
        {
            "time": 1e3 * t + 7000.0,
            "target": 1e3 * path_m(t),
            "actual": 1e3 * path_m(late),
            "speed": 1e3 * v,
            "force": 1e-3 * force,
        }
    )


def map_file(folder: Path, text: str, rig: str = "axis", head: str = "") -> Path:
    """A map for the rig `axis` with these tables."""
    path = folder / "map.toml"
    path.write_text(f'format = "hil-map/1"\nrig = "{rig}"\n{head}\n{text}', encoding="utf-8")
    return path


def bring(
    log: Path, text: str = CLOCK + SIGNALS, head: str = "", rig: str = "axis"
) -> ImportReport:
    """Import `log` by a map of these tables into `run` beside it."""
    return import_run(log, map_file(log.parent, text, rig, head), log.parent / "run")


def brought(log: Path, text: str = CLOCK + SIGNALS, head: str = "", rig: str = "axis") -> Run:
    """The run that the import of `log` makes."""
    return load_run(Path(bring(log, text, head, rig).folder))


def as_csv(folder: Path, table: pd.DataFrame) -> Path:
    """`table` as plain CSV."""
    path = folder / "log.csv"
    table.to_csv(path, index=False)
    return path


def found(report: ImportReport, check: str) -> list[str]:
    """Verdicts and sentences of one check."""
    return [f"{f.verdict} {f.subject}: {f.text}" for f in report.findings if f.check == check]
