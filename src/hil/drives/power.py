"""Power states of a servo drive: the DRIVECOM state machine, which CiA 402 kept bit for bit.

Sources: CiA 402-2 (IEC 61800-7-201), tables of control word and status word; LUST user manual CM-CAN1
(0916.21B.0-00), page 7-4, shows the same bits on the wire: control 0x00, 0x06, 0x0F, answered by status
0x0240, 0x0231, 0x0237 [F].
"""

from __future__ import annotations

from enum import Enum
from typing import Final

from hil.errors import ProtocolError

VOLTAGE_ENABLED: Final = 0x0010
"""Status bit 4: the power stage may be switched on; on a LUST drive, the ENPO input is there [M]."""

REMOTE: Final = 0x0200
"""Status bit 9: the drive listens to the bus."""

RESET_BIT: Final = 0x0080
"""Control bit 7: its rising edge resets a fault."""


class PowerState(Enum):
    """States of the power stage. The value is the state's pattern in the status word."""

    NOT_READY = 0x0000
    SWITCH_ON_DISABLED = 0x0040
    READY_TO_SWITCH_ON = 0x0021
    SWITCHED_ON = 0x0023
    OPERATION_ENABLED = 0x0027
    QUICK_STOP_ACTIVE = 0x0007
    FAULT_REACTION = 0x000F
    FAULT = 0x0008

    def __str__(self) -> str:
        return self.name.lower().replace("_", " ")


class PowerCommand(Enum):
    """Commands to the power stage. The value is the control word that gives them."""

    DISABLE = 0x0000
    QUICK_STOP = 0x0002
    PREPARE = 0x0006
    SWITCH_ON = 0x0007
    ENABLE = 0x000F
    RESET = 0x0080


FAULTED: Final = (PowerState.FAULT, PowerState.FAULT_REACTION)
"""States in which the drive reports a fault."""

PREPARED: Final = (PowerState.READY_TO_SWITCH_ON, PowerState.SWITCHED_ON)
"""States from which one command enables the drive, and in which it makes no force."""

FORCEFUL: Final = (PowerState.OPERATION_ENABLED, PowerState.QUICK_STOP_ACTIVE)
"""States in which it makes force, and goes on with it until it is told to be off."""

_QUICK_STOP_MATTERS: Final = 0x006F  # states that bit 5 tells apart
_QUICK_STOP_FREE: Final = 0x004F  # states in which bit 5 may be anything


def _state_of(bits: int) -> PowerState | None:
    for state in (
        PowerState.READY_TO_SWITCH_ON,
        PowerState.SWITCHED_ON,
        PowerState.OPERATION_ENABLED,
        PowerState.QUICK_STOP_ACTIVE,
    ):
        if bits & _QUICK_STOP_MATTERS == state.value:
            return state
    for state in (
        PowerState.NOT_READY,
        PowerState.SWITCH_ON_DISABLED,
        PowerState.FAULT_REACTION,
        PowerState.FAULT,
    ):
        if bits & _QUICK_STOP_FREE == state.value:
            return state
    return None


_STATES: Final = tuple(_state_of(bits) for bits in range(_QUICK_STOP_MATTERS + 1))
"""By the bits that matter: words come a thousand times a second from each drive."""


def decode_status_word(word: int) -> PowerState:
    """The state in a status word; ProtocolError where the bits are no state."""
    state = _STATES[word & _QUICK_STOP_MATTERS]
    if state is None:
        raise ProtocolError(f"status word {word:#06x} is no state of a drive")
    return state


def encode_status_word(state: PowerState, *, voltage: bool) -> int:
    """The status word of a drive that listens to the bus. `voltage`: its hardware enable is there."""
    shown = voltage and state is not PowerState.SWITCH_ON_DISABLED
    return state.value | REMOTE | (VOLTAGE_ENABLED if shown else 0)


def decode_control_word(word: int) -> PowerCommand:
    """The command in a control word, by the bits that CiA 402 lets decide."""
    if word & RESET_BIT:
        return PowerCommand.RESET
    if not word & 0x02:
        return PowerCommand.DISABLE
    if not word & 0x04:
        return PowerCommand.QUICK_STOP
    if not word & 0x01:
        return PowerCommand.PREPARE
    return PowerCommand.ENABLE if word & 0x08 else PowerCommand.SWITCH_ON


_TRANSITIONS: Final[dict[PowerCommand, dict[PowerState, PowerState]]] = {
    PowerCommand.PREPARE: {
        PowerState.SWITCH_ON_DISABLED: PowerState.READY_TO_SWITCH_ON,
        PowerState.SWITCHED_ON: PowerState.READY_TO_SWITCH_ON,
        PowerState.OPERATION_ENABLED: PowerState.READY_TO_SWITCH_ON,
    },
    PowerCommand.SWITCH_ON: {
        PowerState.READY_TO_SWITCH_ON: PowerState.SWITCHED_ON,
        PowerState.OPERATION_ENABLED: PowerState.SWITCHED_ON,
    },
    PowerCommand.ENABLE: {
        PowerState.READY_TO_SWITCH_ON: PowerState.OPERATION_ENABLED,
        PowerState.SWITCHED_ON: PowerState.OPERATION_ENABLED,
    },
    PowerCommand.QUICK_STOP: {
        PowerState.READY_TO_SWITCH_ON: PowerState.SWITCH_ON_DISABLED,
        PowerState.SWITCHED_ON: PowerState.SWITCH_ON_DISABLED,
        PowerState.OPERATION_ENABLED: PowerState.QUICK_STOP_ACTIVE,
    },
}


def respond(
    state: PowerState, command: PowerCommand, *, reset_edge: bool = False, supplied: bool = True
) -> PowerState:
    """The state a drive goes to on `command`. Faults are left by the edge of the reset bit alone.

    Without its hardware enable or supply (not `supplied`) no power stage is prepared.
    """
    if state in FAULTED or state is PowerState.NOT_READY:
        left = state is PowerState.FAULT and command is PowerCommand.RESET and reset_edge
        return PowerState.SWITCH_ON_DISABLED if left else state
    if command in (PowerCommand.DISABLE, PowerCommand.RESET) or not supplied:
        return PowerState.SWITCH_ON_DISABLED
    return _TRANSITIONS[command].get(state, state)
