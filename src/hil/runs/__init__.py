"""Recordings: what a run leaves behind, written while it runs, read back and checked.

`Recorder` writes a run folder, `load_run` reads one (ours or anybody's), `export_run` hands it on,
`repair_run` mends one that was cut short, `list_runs` and `signal_infos` say what is there.
"""

from hil.runs.catalogue import RunInfo, SignalInfo, list_runs, signal_infos
from hil.runs.export import export_run
from hil.runs.folder import RunMeta
from hil.runs.reader import Run, load_run
from hil.runs.recorder import Recorder
from hil.runs.repair import Repair, repair_run

__all__ = [
    "Recorder",
    "Repair",
    "Run",
    "RunInfo",
    "RunMeta",
    "SignalInfo",
    "export_run",
    "list_runs",
    "load_run",
    "repair_run",
    "signal_infos",
]
