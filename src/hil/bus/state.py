"""The states of a CAN controller, read from the error frames that it and the hub deliver.

Classes and bits as in linux/can/error.h [F]; the states are those of ISO 11898-1 [M].
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import Final

from hil.frames import Frame

ERR_CONTROLLER: Final = 0x004
ERR_BUS_OFF: Final = 0x040
ERR_RESTARTED: Final = 0x100
ERR_ALL: Final = 0x1FFF_FFFF

_WARNING: Final = 0x04 | 0x08
_PASSIVE: Final = 0x10 | 0x20
_ACTIVE: Final = 0x40


class BusState(Enum):
    """What the controller may still do: all, all but with many errors, listen politely, nothing."""

    ERROR_ACTIVE = "error active"
    ERROR_WARNING = "error warning"
    ERROR_PASSIVE = "error passive"
    BUS_OFF = "bus off"


@dataclass(slots=True)
class PortCounters:
    """What passed a port since it was opened."""

    received: int = 0
    """Frames handed out, error frames included."""
    sent: int = 0
    """Frames given to the bus."""
    refused: int = 0
    """Frames that `send` would not or could not give to the bus."""
    malformed: int = 0
    """Records that were no classic CAN frame."""


def state_after(frame: Frame, state: BusState) -> BusState:
    """The controller's state after `frame`, given its state before."""
    if not frame.is_error:
        # A controller that is off receives nothing: it was restarted by hand, without a notice.
        return BusState.ERROR_ACTIVE if state is BusState.BUS_OFF else state
    if frame.can_id & ERR_BUS_OFF:
        return BusState.BUS_OFF
    if frame.can_id & ERR_RESTARTED:
        return BusState.ERROR_ACTIVE
    if frame.can_id & ERR_CONTROLLER and len(frame.data) > 1:
        detail = frame.data[1]
        if detail & _PASSIVE:
            return BusState.ERROR_PASSIVE
        if detail & _WARNING:
            return BusState.ERROR_WARNING
        if detail & _ACTIVE:
            return BusState.ERROR_ACTIVE
    return state


def controller_error(error_class: int) -> Frame:
    """The error frame of class `error_class` that a controller delivers to its own host."""
    return Frame(error_class, bytes(8), is_error=True)
