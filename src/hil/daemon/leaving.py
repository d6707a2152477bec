"""How long a daemon that is told to end may take: control parks, the gateway records that and leaves last."""

from __future__ import annotations

from typing import Final

from hil.config import RigFile
from hil.safety import state_settings

CONTROL_SPARE_S: Final = 2.0
"""For control beyond its rig: the last cycles, and a machine that is busy."""
GATEWAY_END_S: Final = 10.0
"""The gateway gets so long to finish its recording."""


def control_s(rig: RigFile) -> float:
    """After this time control has left, with the rig parked or its power cut, s."""
    return state_settings(rig).leave_time_s + CONTROL_SPARE_S


def daemon_s(rig: RigFile) -> float:
    """After this time both processes have left, s."""
    return control_s(rig) + GATEWAY_END_S
