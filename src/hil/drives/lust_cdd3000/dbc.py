"""The CANLust frames of a rig as a DBC file, for cantools, SavvyCAN and other bus tools.

Raw increments throughout: scales are the rig file's affair.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

from hil.drives.lust_cdd3000.codec import FRAME_LENGTH, SYSTEM_LENGTH, AnswerStatus, frame_ids
from hil.drives.profile import LustProfile

_MASTER: Final = "MASTER"
_UINT: Final = "+"
_INT: Final = "-"


@dataclass(frozen=True, slots=True)
class _Signal:
    name: str
    start_bit: int
    bits: int
    sign: str = _UINT

    def line(self, receiver: str) -> str:
        low = -(2 ** (self.bits - 1)) if self.sign == _INT else 0
        high = low + 2**self.bits - 1
        return (
            f" SG_ {self.name} : {self.start_bit}|{self.bits}@1{self.sign} (1,0) "
            f'[{low}|{high}] "" {receiver}'
        )


def render(profile: LustProfile, addresses: Iterable[int]) -> str:
    """The DBC text of the drives at `addresses`; message names end in the address."""
    addresses = sorted(set(addresses))
    nodes = [f"DRIVE_{a}" for a in addresses]
    lines = ['VERSION ""', "", "NS_ :", "", "BS_:", "", f"BU_: {_MASTER} {' '.join(nodes)}", ""]
    lines += _message(
        profile.ids.system,
        "SYSTEM",
        SYSTEM_LENGTH,
        _MASTER,
        "Vector__XXX",
        [_Signal("Start", 0, 8)],
    )
    comments = [f'CM_ BO_ {profile.ids.system} "System Start/Stop, to all drives";']
    values = [
        f'VAL_ {profile.ids.system} Start {profile.system.start} "start" '
        f'{profile.system.stop} "stop" ;'
    ]
    statuses = " ".join(f'{bit.value} "{bit}"' for bit in reversed(AnswerStatus))
    for address, node in zip(addresses, nodes, strict=True):
        ids = frame_ids(profile.ids, address)
        for can_id, name, length, from_drive, signals, text in (
            (ids.error, "ERROR", FRAME_LENGTH, True, _error(profile), "Error frame"),
            (ids.control, "CONTROL", FRAME_LENGTH, False, _control(profile), "Command, reference"),
            (ids.status, "STATUS", FRAME_LENGTH, True, _status(profile), "State and actual value"),
            (ids.request, "REQUEST", FRAME_LENGTH, False, _parameter("Mode"), "Parameter request"),
            (ids.answer, "ANSWER", FRAME_LENGTH, True, _parameter("Result"), "Parameter answer"),
            (ids.log_on, "LOGON", 0, True, [], "Log-on, every 100 ms until addressed"),
        ):
            sender, receiver = (node, _MASTER) if from_drive else (_MASTER, node)
            lines += _message(can_id, f"{name}_{address}", length, sender, receiver, signals)
            comments.append(f'CM_ BO_ {can_id} "{text}";')
        values.append(f'VAL_ {ids.request} Mode 5 "read" 2 "write" ;')
        values.append(f'VAL_ {ids.answer} Result {statuses} 0 "ok" ;')
    return "\n".join([*lines, *comments, "", *values, ""])


def _message(
    can_id: int, name: str, length: int, sender: str, receiver: str, signals: list[_Signal]
) -> list[str]:
    head = f"BO_ {can_id} {name}: {length} {sender}"
    return [head, *(signal.line(receiver) for signal in signals), ""]


def _control(profile: LustProfile) -> list[_Signal]:
    layout = profile.layout
    reference = _Signal("Reference", 8 * layout.value_byte, 32, _INT)
    if layout.kind == "drivecom":
        return [_Signal("ControlWord", 0, 16), reference]
    flags = 8 * layout.flags_byte
    return [
        _Signal("ControllerOn", 0, 1),
        _Signal("ErrorReset", 7, 1),
        _Signal("Automatic", flags, 1),
        _Signal("Sequence", flags + 1, 1),
        reference,
    ]


def _status(profile: LustProfile) -> list[_Signal]:
    layout = profile.layout
    flags = 8 * layout.flags_byte
    rest = [
        _Signal("Referenced", flags, 1),
        _Signal("Automatic", flags + 1, 1),
        _Signal("Actual", 8 * layout.value_byte, 32, _INT),
    ]
    if layout.kind == "drivecom":
        return [_Signal("StatusWord", 0, 16), *rest]
    return [
        _Signal("Error", 0, 1),
        _Signal("SystemStarted", 1, 1),
        _Signal("ReferenceReached", 2, 1),
        _Signal("PowerActive", 4, 1),
        _Signal("Standstill", 5, 1),
        _Signal("Ready", 7, 1),
        _Signal("Enpo", 8, 1),
        *rest,
    ]


def _error(profile: LustProfile) -> list[_Signal]:
    layout = profile.error_frame
    return [
        _Signal("Code", 8 * layout.code_byte, 8),
        _Signal("Location", 8 * layout.location_byte, 8),
        _Signal("Hours", 8 * layout.hours_byte, 16),
    ]


def _parameter(third: str) -> list[_Signal]:
    return [
        _Signal("Number", 0, 16),
        _Signal(third, 16, 8),
        _Signal("Value", 24, 32, _INT),
        _Signal("Index", 56, 8),
    ]
