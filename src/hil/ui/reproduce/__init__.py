"""The papers again: their experiments on the simulated rigs, through the whole daemon, as one page each.

`motorcycle_report`, `stewart_report` and `bicycle_report` play, analyse and write; `Lengths` says how long,
`Report` what came.
"""

from hil.ui.reproduce.bicycle import bicycle_report
from hil.ui.reproduce.motorcycle import motorcycle_report
from hil.ui.reproduce.report import FAST, FULL, Lengths, Report
from hil.ui.reproduce.stewart import stewart_report

__all__ = [
    "FAST", "FULL", "Lengths", "Report", "bicycle_report", "motorcycle_report", "stewart_report",
]  # fmt: skip
