"""What to ask the rig for: cues judged and shaped, state observed, setpoints by three modes.

Everything is a pure step: time comes in as an argument, nothing is read or sent.
"""

from hil.control.guard import CueGuard, Verdict
from hil.control.modes import Controller, build_controller
from hil.control.observer import Observed, Observer
from hil.control.reference import Reference
from hil.control.setpoints import Setpoints
from hil.control.shaping import CueShaper

__all__ = [
    "Controller",
    "CueGuard",
    "CueShaper",
    "Observed",
    "Observer",
    "Reference",
    "Setpoints",
    "Verdict",
    "build_controller",
]
