"""Frames of CANLust: each one's bytes from values and back, and its identifier.

Every function is pure; decoding raises ProtocolError on what the protocol does not allow. Layouts and
marks: drives/lust_cdd3000/drive.toml. All numbers are little endian; all parameters travel as four bytes
(user manual CM-CAN1, 4-2 and 4-3) [F].
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from enum import IntEnum, IntFlag
from typing import Final

from hil.drives.power import (
    VOLTAGE_ENABLED,
    PowerCommand,
    PowerState,
    decode_control_word,
    decode_status_word,
    encode_status_word,
)
from hil.drives.profile import BaseIds, ErrorLayout, Layout, WireType
from hil.errors import ProtocolError
from hil.frames import Frame

FRAME_LENGTH: Final = 8
SYSTEM_LENGTH: Final = 1
INT32_MIN: Final = -(2**31)
INT32_MAX: Final = 2**31 - 1

FLOAT32_MAX: Final = 3.4028234663852886e38
_STEPS: Final[dict[str, int]] = {"int32": 1, "int32q16": 65536, "fixpoint16": 20}
"""Steps to one unit: int32q16 has 16 binary places, fixpoint16 counts twentieths."""

_PARAMETER: Final = struct.Struct("<HBiB")
_INT32: Final = struct.Struct("<i")
_UINT16: Final = struct.Struct("<H")
_FLOAT32: Final = struct.Struct("<f")


@dataclass(frozen=True, slots=True)
class FrameIds:
    """Identifiers of one drive's frames."""

    error: int
    control: int
    status: int
    request: int
    answer: int
    log_on: int


def frame_ids(base: BaseIds, address: int) -> FrameIds:
    """Identifiers of the drive at `address`: base + stride * address."""
    offset = base.stride * address
    return FrameIds(
        error=base.error + offset,
        control=base.control + offset,
        status=base.status + offset,
        request=base.request + offset,
        answer=base.answer + offset,
        log_on=base.log_on + offset,
    )


class Mode(IntEnum):
    """What a parameter request wants."""

    WRITE = 2
    READ = 5


class AnswerStatus(IntFlag):
    """Status byte of a parameter answer; 0 is success."""

    UNASSIGNED = 0x01
    SIO_WATCHDOG = 0x02
    UNKNOWN_MODE = 0x04
    NO_READ = 0x08
    REPEAT_ACTION = 0x10
    UNKNOWN_PARAMETER = 0x20
    CHANGE_NOT_PERMITTED = 0x40
    BAD_VALUE = 0x80

    def __str__(self) -> str:
        names = [str(bit.name).lower().replace("_", " ") for bit in AnswerStatus if bit in self]
        return ", ".join(names) or "ok"


@dataclass(frozen=True, slots=True)
class Control:
    """Master to drive, cyclic. `reference` in the drive's increments, int32."""

    command: PowerCommand = PowerCommand.DISABLE
    reference: int = 0
    automatic: bool = False
    """posmod only: take references from the bus."""
    sequence: bool = False
    """posmod only: run the drive's own sequence."""


@dataclass(frozen=True, slots=True)
class Status:
    """Drive to master. `actual` in the drive's increments, int32."""

    power: PowerState
    enpo: bool
    referenced: bool = False
    automatic: bool = False
    actual: int = 0


@dataclass(frozen=True, slots=True)
class Request:
    """A question on the parameter channel. `value` is the four bytes on the wire as int32."""

    number: int
    mode: Mode
    value: int = 0
    index: int = 0


@dataclass(frozen=True, slots=True)
class Answer:
    """The drive's answer to a request."""

    number: int
    status: AnswerStatus
    value: int = 0
    index: int = 0


@dataclass(frozen=True, slots=True)
class ErrorReport:
    """What an error frame says; None where the frame is too short to say it."""

    code: int | None
    location: int | None
    hours: int | None


def clamp_int32(value: float) -> int:
    """The int32 nearest to a finite value."""
    return round(min(max(value, INT32_MIN), INT32_MAX))


def to_wire(kind: WireType, value: float) -> int:
    """The int32 whose four bytes carry a finite `value` as data type `kind`; saturates at its range."""
    if kind == "float32":
        raw: int = _INT32.unpack(_FLOAT32.pack(min(max(value, -FLOAT32_MAX), FLOAT32_MAX)))[0]
        return raw
    return clamp_int32(value * _STEPS[kind])


def from_wire(kind: WireType, raw: int) -> float:
    """The value that the four bytes of int32 `raw` carry as data type `kind`; float32 may be NaN."""
    if kind == "float32":
        value: float = _FLOAT32.unpack(_INT32.pack(raw))[0]
        return value
    return raw / _STEPS[kind]


def encode_system(base: BaseIds, byte: int) -> Frame:
    """System Start or Stop, to all drives."""
    return Frame(base.system, bytes([byte]))


def decode_system(data: bytes) -> int:
    """Byte 0 of a System frame."""
    if not data:
        raise ProtocolError("a System frame has at least one byte")
    return data[0]


def encode_control(can_id: int, layout: Layout, control: Control) -> Frame:
    """Control frame; ProtocolError where the reference is no int32."""
    data = bytearray(FRAME_LENGTH)
    if layout.kind == "drivecom":
        _UINT16.pack_into(data, 0, control.command.value)
    else:
        data[0] = {PowerCommand.ENABLE: 0x01, PowerCommand.RESET: 0x80}.get(control.command, 0)
        data[layout.flags_byte] = control.automatic | control.sequence << 1
    _put_int32(data, layout.value_byte, control.reference)
    return Frame(can_id, bytes(data))


def decode_control(layout: Layout, data: bytes) -> Control:
    """Control frame's meaning. In posmod all commands but ENABLE and RESET read as DISABLE."""
    _need_eight(data, "control")
    (reference,) = _INT32.unpack_from(data, layout.value_byte)
    if layout.kind == "drivecom":
        return Control(decode_control_word(_UINT16.unpack_from(data, 0)[0]), reference)
    command = (
        PowerCommand.RESET
        if data[0] & 0x80
        else PowerCommand.ENABLE
        if data[0] & 0x01
        else PowerCommand.DISABLE
    )
    flags = data[layout.flags_byte]
    return Control(command, reference, bool(flags & 0x01), bool(flags & 0x02))


def encode_status(can_id: int, layout: Layout, status: Status) -> Frame:
    """Status frame as a drive sends it."""
    data = bytearray(FRAME_LENGTH)
    if layout.kind == "drivecom":
        _UINT16.pack_into(data, 0, encode_status_word(status.power, voltage=status.enpo))
    else:
        data[0] = _POSMOD_STATES[status.power]
        data[1] = 0x01 if status.enpo else 0x00
    data[layout.flags_byte] |= status.referenced | status.automatic << 1
    _put_int32(data, layout.value_byte, status.actual)
    return Frame(can_id, bytes(data))


_POSMOD_STATES: Final = {
    PowerState.NOT_READY: 0x00,
    PowerState.SWITCH_ON_DISABLED: 0x00,
    PowerState.READY_TO_SWITCH_ON: 0x80,
    PowerState.SWITCHED_ON: 0x80,
    PowerState.OPERATION_ENABLED: 0x90,
    PowerState.QUICK_STOP_ACTIVE: 0x80,
    PowerState.FAULT_REACTION: 0x01,
    PowerState.FAULT: 0x01,
}


def decode_status(layout: Layout, data: bytes) -> Status:
    """Status frame's meaning; in posmod the bits error, active and ready stand for the power state."""
    _need_eight(data, "status")
    flags = data[layout.flags_byte]
    (actual,) = _INT32.unpack_from(data, layout.value_byte)
    if layout.kind == "drivecom":
        (word,) = _UINT16.unpack_from(data, 0)
        power, enpo = decode_status_word(word), bool(word & VOLTAGE_ENABLED)
    else:
        enpo = bool(data[1] & 0x01)
        if data[0] & 0x01:
            power = PowerState.FAULT
        elif data[0] & 0x10:
            power = PowerState.OPERATION_ENABLED
        elif data[0] & 0x80 and enpo:
            power = PowerState.READY_TO_SWITCH_ON
        else:
            power = PowerState.SWITCH_ON_DISABLED
    return Status(power, enpo, bool(flags & 0x01), bool(flags & 0x02), actual)


NUMBERS: Final = range(1 << 16)
"""That a parameter may have: two bytes in a request."""


def encode_request(can_id: int, request: Request) -> Frame:
    """Parameter request."""
    return Frame(
        can_id, _PARAMETER.pack(request.number, request.mode, request.value, request.index)
    )


def decode_request(data: bytes) -> tuple[int, int, int, int]:
    """Number, mode, value and index of a parameter request; any mode is handed on."""
    _need_eight(data, "parameter request")
    number, mode, value, index = _PARAMETER.unpack(data)
    return number, mode, value, index


def encode_answer(can_id: int, answer: Answer) -> Frame:
    """Parameter answer as a drive sends it."""
    return Frame(can_id, _PARAMETER.pack(answer.number, answer.status, answer.value, answer.index))


def decode_answer(data: bytes) -> Answer:
    """Parameter answer's meaning."""
    _need_eight(data, "parameter answer")
    number, status, value, index = _PARAMETER.unpack(data)
    return Answer(number, AnswerStatus(status), value, index)


def encode_error(can_id: int, layout: ErrorLayout, code: int, location: int, hours: int) -> Frame:
    """Error frame as a drive sends it."""
    data = bytearray(FRAME_LENGTH)
    data[layout.code_byte] = code
    data[layout.location_byte] = location
    _UINT16.pack_into(data, layout.hours_byte, hours)
    return Frame(can_id, bytes(data))


def decode_error(layout: ErrorLayout, data: bytes) -> ErrorReport:
    """What an error frame says. Never raises: an error frame of any length is an error."""
    size = len(data)
    return ErrorReport(
        data[layout.code_byte] if layout.code_byte < size else None,
        data[layout.location_byte] if layout.location_byte < size else None,
        _UINT16.unpack_from(data, layout.hours_byte)[0] if layout.hours_byte + 1 < size else None,
    )


def _need_eight(data: bytes, what: str) -> None:
    if len(data) != FRAME_LENGTH:
        raise ProtocolError(f"a {what} frame has {FRAME_LENGTH} bytes, got {len(data)}")


def _put_int32(data: bytearray, offset: int, value: int) -> None:
    try:
        _INT32.pack_into(data, offset, value)
    except struct.error as error:
        raise ProtocolError(f"{value} does not fit the four bytes of a value") from error
