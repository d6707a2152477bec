"""Bytes of CANLust frames, against the examples of the manual and the PLC driver's bits."""

from __future__ import annotations

import math
import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hil.drives.lust_cdd3000.codec import (
    INT32_MAX,
    INT32_MIN,
    Answer,
    AnswerStatus,
    Control,
    Mode,
    Request,
    Status,
    decode_answer,
    decode_control,
    decode_error,
    decode_request,
    decode_status,
    decode_system,
    encode_answer,
    encode_control,
    encode_error,
    encode_request,
    encode_status,
    encode_system,
    frame_ids,
    from_wire,
    to_wire,
)
from hil.drives.power import PowerCommand, PowerState
from hil.errors import ProtocolError
from tests.drives.exchange import profile_of

DRIVECOM = profile_of().layout
POSMOD = profile_of(layout={"kind": "posmod"}).layout
INT32S = st.integers(INT32_MIN, INT32_MAX)
BOUNDARIES = [INT32_MIN, INT32_MIN + 1, -1, 0, 1, 0x1234_5678, INT32_MAX - 1, INT32_MAX]


def test_identifiers_are_base_plus_stride_times_address() -> None:
    """User manual CM-CAN1, 7-4: CDA 1 has control 663, status 883 and log-on 1545."""
    ids = frame_ids(profile_of(ids={"stride": 2}).ids, 1)
    assert (ids.control, ids.status, ids.log_on) == (663, 883, 1545)
    ids = frame_ids(profile_of().ids, 3)
    assert (ids.error, ids.request, ids.answer) == (444, 1104, 1324)


def test_system_start_is_the_manuals_frame() -> None:
    profile = profile_of()
    frame = encode_system(profile.ids, profile.system.start)
    assert str(frame) == "0DD#01"
    assert decode_system(frame.data) == 1
    with pytest.raises(ProtocolError):
        decode_system(b"")


@pytest.mark.parametrize(
    ("command", "text"),
    [
        (PowerCommand.DISABLE, "0000000004030201"),
        (PowerCommand.PREPARE, "0600000004030201"),
        (PowerCommand.ENABLE, "0F00000004030201"),
        (PowerCommand.RESET, "8000000004030201"),
    ],
)
def test_drivecom_control_bytes(command: PowerCommand, text: str) -> None:
    frame = encode_control(0x296, DRIVECOM, Control(command, 0x01020304))
    assert str(frame) == f"296#{text}"
    assert decode_control(DRIVECOM, frame.data) == Control(command, 0x01020304)


@pytest.mark.parametrize(
    ("control", "text"),
    [
        (Control(PowerCommand.DISABLE), "0000000000000000"),
        (Control(PowerCommand.ENABLE, -1), "01000000FFFFFFFF"),
        (Control(PowerCommand.ENABLE, 0, automatic=True), "0100010000000000"),
        (Control(PowerCommand.ENABLE, 0, automatic=True, sequence=True), "0100030000000000"),
        (Control(PowerCommand.RESET), "8000000000000000"),
    ],
)
def test_posmod_control_bits(control: Control, text: str) -> None:
    frame = encode_control(0x296, POSMOD, control)
    assert str(frame) == f"296#{text}"
    assert decode_control(POSMOD, frame.data) == control


@pytest.mark.parametrize("value", BOUNDARIES)
@pytest.mark.parametrize("layout", [DRIVECOM, POSMOD])
def test_references_and_actual_values_keep_every_bit(value: int, layout) -> None:
    control = Control(PowerCommand.ENABLE, value)
    assert decode_control(layout, encode_control(1, layout, control).data) == control
    status = Status(PowerState.OPERATION_ENABLED, enpo=True, referenced=True, actual=value)
    assert decode_status(layout, encode_status(1, layout, status).data) == status


@pytest.mark.parametrize("value", [INT32_MIN - 1, INT32_MAX + 1, 10**30])
def test_a_reference_beyond_four_bytes_is_refused(value: int) -> None:
    with pytest.raises(ProtocolError, match="does not fit"):
        encode_control(1, DRIVECOM, Control(PowerCommand.ENABLE, value))


@pytest.mark.parametrize(
    ("data", "state", "enpo"),
    [
        ("4002000000000000", PowerState.SWITCH_ON_DISABLED, False),
        ("3102000000000000", PowerState.READY_TO_SWITCH_ON, True),
        ("3702000000000000", PowerState.OPERATION_ENABLED, True),
        ("1802000000000000", PowerState.FAULT, True),
    ],
)
def test_drivecom_status_words_of_the_manual(data: str, state: PowerState, enpo: bool) -> None:
    status = decode_status(DRIVECOM, bytes.fromhex(data))
    assert (status.power, status.enpo) == (state, enpo)


@pytest.mark.parametrize(
    ("data", "state"),
    [
        ("0100000000000000", PowerState.FAULT),
        ("9101000000000000", PowerState.FAULT),  # an error outweighs all else
        ("9001000000000000", PowerState.OPERATION_ENABLED),
        ("8001000000000000", PowerState.READY_TO_SWITCH_ON),
        ("8000000000000000", PowerState.SWITCH_ON_DISABLED),  # ready, but no ENPO
        ("0001000000000000", PowerState.SWITCH_ON_DISABLED),
    ],
)
def test_posmod_status_bits_stand_for_the_power_state(data: str, state: PowerState) -> None:
    status = decode_status(POSMOD, bytes.fromhex(data))
    assert status.power is state
    assert status.enpo == bool(int(data[2:4], 16) & 1)


def test_status_flags_are_referenced_and_automatic() -> None:
    for layout in (DRIVECOM, POSMOD):
        word = "3702" if layout is DRIVECOM else "9001"
        for flags, expected in ((0, (False, False)), (1, (True, False)), (2, (False, True))):
            status = decode_status(layout, bytes.fromhex(f"{word}{flags:02x}0000000000"))
            assert (status.referenced, status.automatic) == expected


def test_a_parameter_request_is_little_endian() -> None:
    frame = encode_request(0x44E, Request(574, Mode.WRITE, 100))
    assert str(frame) == "44E#3E02026400000000"
    assert decode_request(frame.data) == (574, 2, 100, 0)
    assert str(encode_request(0x44E, Request(574, Mode.READ))) == "44E#3E02050000000000"


@given(st.integers(0, 0xFFFF), st.sampled_from(Mode), INT32S, st.integers(0, 255))
def test_requests_survive(number: int, mode: Mode, value: int, index: int) -> None:
    request = Request(number, mode, value, index)
    assert decode_request(encode_request(1, request).data) == (number, mode, value, index)


@given(st.integers(0, 0xFFFF), st.integers(0, 255), INT32S, st.integers(0, 255))
def test_answers_survive_with_every_status(number: int, bits: int, value: int, index: int) -> None:
    answer = Answer(number, AnswerStatus(bits), value, index)
    assert decode_answer(encode_answer(1, answer).data) == answer


@pytest.mark.parametrize(
    ("bit", "name"),
    [
        (1, "sio watchdog"),
        (2, "unknown mode"),
        (3, "no read"),
        (4, "repeat action"),
        (5, "unknown parameter"),
        (6, "change not permitted"),
        (7, "bad value"),
    ],
)
def test_each_status_bit_has_its_name(bit: int, name: str) -> None:
    status = decode_answer(bytes([0, 0, 1 << bit, 0, 0, 0, 0, 0])).status
    assert str(status) == name


def test_a_status_byte_of_zero_is_ok() -> None:
    assert str(AnswerStatus(0)) == "ok"
    assert str(AnswerStatus(0xA0)) == "unknown parameter, bad value"


@pytest.mark.parametrize("length", [0, 1, 7])
def test_frames_of_wrong_length_are_no_frames(length: int) -> None:
    data = bytes(length)
    for decode in (
        decode_answer,
        decode_request,
        lambda d: decode_status(DRIVECOM, d),
        lambda d: decode_control(DRIVECOM, d),
    ):
        with pytest.raises(ProtocolError, match="8 bytes"):
            decode(data)


def test_an_error_frame_tells_code_location_and_hours() -> None:
    layout = profile_of().error_frame
    frame = encode_error(0x1BA, layout, 33, 2, 0x1234)
    assert str(frame) == "1BA#2102341200000000"
    report = decode_error(layout, frame.data)
    assert (report.code, report.location, report.hours) == (33, 2, 0x1234)


@pytest.mark.parametrize("length", range(9))
def test_an_error_frame_of_any_length_is_an_error(length: int) -> None:
    report = decode_error(profile_of().error_frame, bytes([33, 2, 1, 0, 0, 0, 0, 0])[:length])
    assert report.code == (33 if length > 0 else None)
    assert report.hours == (1 if length > 3 else None)


@pytest.mark.parametrize(
    ("kind", "value", "raw"),
    [
        ("int32", -5.0, -5),
        ("int32q16", 20.5, 0x0014_8000),  # the manual's example, 5-13
        ("int32q16", -0.5, -0x8000),
        ("fixpoint16", 0.05, 1),
        ("float32", 1.0, 0x3F80_0000),
        ("float32", -2.0, struct.unpack("<i", struct.pack("<f", -2.0))[0]),
    ],
)
def test_data_types_of_the_manual(kind, value: float, raw: int) -> None:
    assert to_wire(kind, value) == raw
    assert from_wire(kind, raw) == value


@pytest.mark.parametrize("kind", ["int32", "int32q16", "fixpoint16", "float32"])
@given(value=st.floats(allow_nan=False, allow_infinity=False))
def test_any_finite_value_has_a_wire_value_and_saturates(kind, value: float) -> None:
    raw = to_wire(kind, value)
    assert INT32_MIN <= raw <= INT32_MAX
    back = from_wire(kind, raw)
    assert math.isfinite(back)
    assert abs(back) <= abs(value) * (1 + 1e-6) + 0.5
