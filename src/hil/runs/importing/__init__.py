"""Foreign logs as run folders: read by a map, converted to SI, their clocks and signals checked.

`load_map` reads the map of a log's columns, `import_run` makes the run folder and reports its checks.
"""

from hil.runs.importing.findings import Finding
from hil.runs.importing.importer import ImportReport, SignalReport, import_run
from hil.runs.importing.mapfile import ImportMap, find_map, load_map

__all__ = [
    "Finding",
    "ImportMap",
    "ImportReport",
    "SignalReport",
    "find_map",
    "import_run",
    "load_map",
]
