"""Status and control words of the DRIVECOM machine, against the tables of CiA 402 and the LUST manual."""

from __future__ import annotations

import pytest

from hil.drives.power import (
    FAULTED,
    PowerCommand,
    PowerState,
    decode_control_word,
    decode_status_word,
    encode_status_word,
    respond,
)
from hil.errors import ProtocolError

CIA_402 = {  # IEC 61800-7-201, table of statusword bits: x = any
    "xxxxxxxxx0xx0000": PowerState.NOT_READY,
    "xxxxxxxxx1xx0000": PowerState.SWITCH_ON_DISABLED,
    "xxxxxxxxx01x0001": PowerState.READY_TO_SWITCH_ON,
    "xxxxxxxxx01x0011": PowerState.SWITCHED_ON,
    "xxxxxxxxx01x0111": PowerState.OPERATION_ENABLED,
    "xxxxxxxxx00x0111": PowerState.QUICK_STOP_ACTIVE,
    "xxxxxxxxx0xx1111": PowerState.FAULT_REACTION,
    "xxxxxxxxx0xx1000": PowerState.FAULT,
}


def expected(word: int) -> PowerState | None:
    bits = f"{word:016b}"
    for pattern, state in CIA_402.items():
        if all(p in ("x", b) for p, b in zip(pattern, bits, strict=True)):
            return state
    return None


def test_every_status_word_reads_as_the_standard_says() -> None:
    for word in range(0x10000):
        state = expected(word)
        if state is None:
            with pytest.raises(ProtocolError):
                decode_status_word(word)
        else:
            assert decode_status_word(word) is state


@pytest.mark.parametrize("state", list(PowerState))
@pytest.mark.parametrize("voltage", [True, False])
def test_a_status_word_survives_the_way_there_and_back(state: PowerState, voltage: bool) -> None:
    assert decode_status_word(encode_status_word(state, voltage=voltage)) is state


@pytest.mark.parametrize(
    ("control", "status"),
    [(0x00, 0x0240), (0x06, 0x0231), (0x0F, 0x0237)],
)
def test_the_manuals_example_sequence(control: int, status: int) -> None:
    """User manual CM-CAN1, page 7-4: what the drive answers to each control word."""
    state = PowerState.SWITCH_ON_DISABLED
    for word in (0x00, 0x06, 0x0F):
        state = respond(state, decode_control_word(word))
        if word == control:
            break
    assert encode_status_word(state, voltage=True) == status


@pytest.mark.parametrize("command", list(PowerCommand))
def test_a_control_word_reads_as_the_command_that_made_it(command: PowerCommand) -> None:
    assert decode_control_word(command.value) is command


@pytest.mark.parametrize("state", list(PowerState))
def test_only_the_enable_command_enables_and_only_a_prepared_drive(state: PowerState) -> None:
    for command in PowerCommand:
        for edge in (False, True):
            after = respond(state, command, reset_edge=edge)
            if after is PowerState.OPERATION_ENABLED and state is not after:
                assert command is PowerCommand.ENABLE
                assert state in (PowerState.READY_TO_SWITCH_ON, PowerState.SWITCHED_ON)


@pytest.mark.parametrize("command", list(PowerCommand))
def test_a_fault_is_left_by_the_edge_of_the_reset_bit_alone(command: PowerCommand) -> None:
    assert respond(PowerState.FAULT, command) is PowerState.FAULT
    after = respond(PowerState.FAULT, command, reset_edge=True)
    left = command is PowerCommand.RESET
    assert (after is PowerState.SWITCH_ON_DISABLED) == left
    assert respond(PowerState.FAULT_REACTION, command, reset_edge=True) is PowerState.FAULT_REACTION


@pytest.mark.parametrize("state", [s for s in PowerState if "FAULT" not in s.name])
def test_disable_takes_power_from_every_state(state: PowerState) -> None:
    after = respond(state, PowerCommand.DISABLE)
    assert after in (PowerState.SWITCH_ON_DISABLED, PowerState.NOT_READY)


@pytest.mark.parametrize("state", [s for s in PowerState if s not in FAULTED])
@pytest.mark.parametrize("command", list(PowerCommand))
def test_without_its_supply_no_power_stage_is_prepared(state, command):
    if state is not PowerState.NOT_READY:
        assert respond(state, command, supplied=False) is PowerState.SWITCH_ON_DISABLED
    assert respond(PowerState.FAULT, command, supplied=False) is PowerState.FAULT
