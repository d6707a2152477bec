"""Recordings: what a run leaves behind, written while it runs, read back and checked.

`Recorder` writes a run folder, `load_run` reads one (ours or anybody's), `export_run` hands it on,
`repair_run` mends one that was cut short, `list_runs` and `signal_infos` say what is there.
`cue_from_log` makes a cue trajectory of a measured ride, `write_cue_file` and `read_cue_file` keep it.
"""

from hil.runs.catalogue import RunInfo, SignalInfo, list_runs, signal_infos
from hil.runs.cuefile import CueFile, read_cue_file, write_cue_file
from hil.runs.cuelog import ImportedCue, cue_from_log
from hil.runs.cuemap import CueMap, read_cue_map
from hil.runs.export import export_run
from hil.runs.folder import RunMeta
from hil.runs.reader import Run, load_run
from hil.runs.recorder import Recorder
from hil.runs.repair import Repair, repair_run

__all__ = [
    "CueFile",
    "CueMap",
    "ImportedCue",
    "Recorder",
    "Repair",
    "Run",
    "RunInfo",
    "RunMeta",
    "SignalInfo",
    "cue_from_log",
    "export_run",
    "list_runs",
    "load_run",
    "read_cue_file",
    "read_cue_map",
    "repair_run",
    "signal_infos",
    "write_cue_file",
]
