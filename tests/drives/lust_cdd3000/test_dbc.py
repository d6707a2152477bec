"""The DBC and the codec say the same of every frame, both ways, by cantools' reading of the DBC."""

from __future__ import annotations

import cantools
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hil.configfile import data_folder
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
    encode_answer,
    encode_control,
    encode_error,
    encode_request,
    encode_status,
    encode_system,
    frame_ids,
)
from hil.drives.lust_cdd3000.dbc import render
from hil.drives.power import PowerCommand, PowerState, encode_status_word
from hil.errors import ProtocolError
from tests.drives.exchange import profile_of

PROFILES = {
    "drivecom": profile_of(),
    "posmod": profile_of(layout={"kind": "posmod"}),
    "cda3000": profile_of(layout={"value_byte": 2, "flags_byte": 6}, ids={"stride": 2}),
}
ADDRESSES = (1, 2, 3)
DATABASES = {k: cantools.database.load_string(render(p, ADDRESSES)) for k, p in PROFILES.items()}

INT32S = st.integers(INT32_MIN, INT32_MAX)
EIGHT = st.binary(min_size=8, max_size=8)
NAMES = st.sampled_from(sorted(PROFILES))
WHERE = st.sampled_from(ADDRESSES)
COMMANDS = st.sampled_from(
    [PowerCommand.DISABLE, PowerCommand.PREPARE, PowerCommand.ENABLE, PowerCommand.RESET]
)


def read(name: str, can_id: int, data: bytes) -> dict:
    return DATABASES[name].decode_message(can_id, data, decode_choices=False, scaling=False)


def test_the_shipped_file_is_what_render_makes_of_the_shipped_drive_file() -> None:
    text = (data_folder("drives") / "lust_cdd3000" / "frames.dbc").read_text()
    assert text == render(profile_of(), ADDRESSES)


@pytest.mark.parametrize("name", PROFILES)
def test_every_frame_of_every_address_is_there(name: str) -> None:
    ids = {m.frame_id for m in DATABASES[name].messages}
    base = PROFILES[name].ids
    own = [frame_ids(base, a) for a in ADDRESSES]
    expected = {base.system}
    for i in own:
        expected |= {i.error, i.control, i.status, i.request, i.answer, i.log_on}
    assert ids == expected


@given(NAMES, WHERE, COMMANDS, INT32S, st.booleans(), st.booleans())
def test_control_frames(
    name: str, address: int, command: PowerCommand, reference: int, auto: bool, sequence: bool
) -> None:
    profile = PROFILES[name]
    can_id = frame_ids(profile.ids, address).control
    control = Control(command, reference, auto, sequence)
    data = encode_control(can_id, profile.layout, control).data
    fields = read(name, can_id, data)
    assert fields["Reference"] == reference
    if name == "posmod":
        assert fields["ControllerOn"] == (command is PowerCommand.ENABLE)
        assert fields["ErrorReset"] == (command is PowerCommand.RESET)
        assert (fields["Automatic"], fields["Sequence"]) == (auto, sequence)
    else:
        assert fields["ControlWord"] == command.value
    assert DATABASES[name].encode_message(can_id, fields, scaling=False) == data


@given(NAMES, WHERE, EIGHT)
def test_any_control_bytes_read_alike(name: str, address: int, data: bytes) -> None:
    profile = PROFILES[name]
    can_id = frame_ids(profile.ids, address).control
    assert decode_control(profile.layout, data).reference == read(name, can_id, data)["Reference"]


@given(NAMES, WHERE, st.sampled_from(PowerState), st.booleans(), st.booleans(), INT32S)
def test_status_frames(
    name: str, address: int, power: PowerState, enpo: bool, referenced: bool, actual: int
) -> None:
    profile = PROFILES[name]
    can_id = frame_ids(profile.ids, address).status
    data = encode_status(
        can_id, profile.layout, Status(power, enpo, referenced, False, actual)
    ).data
    fields = read(name, can_id, data)
    assert (fields["Actual"], fields["Referenced"]) == (actual, referenced)
    if name == "posmod":
        assert fields["Enpo"] == enpo
        assert fields["PowerActive"] == (power is PowerState.OPERATION_ENABLED)
        assert fields["Error"] == ("FAULT" in power.name)
    else:
        assert fields["StatusWord"] == encode_status_word(power, voltage=enpo)
    assert DATABASES[name].encode_message(can_id, fields, scaling=False) == data


@given(NAMES, WHERE, EIGHT)
def test_any_status_bytes_read_alike(name: str, address: int, data: bytes) -> None:
    profile = PROFILES[name]
    can_id = frame_ids(profile.ids, address).status
    fields = read(name, can_id, data)
    try:
        status = decode_status(profile.layout, data)
    except ProtocolError:
        return  # bits that are no state: the DBC has no such notion
    assert status.actual == fields["Actual"]
    assert (status.referenced, status.automatic) == (fields["Referenced"], fields["Automatic"])


@given(NAMES, WHERE, st.integers(0, 0xFFFF), st.sampled_from(Mode), INT32S, st.integers(0, 255))
def test_requests(name: str, address: int, number: int, mode: Mode, value: int, index: int) -> None:
    can_id = frame_ids(PROFILES[name].ids, address).request
    data = encode_request(can_id, Request(number, mode, value, index)).data
    fields = {"Number": number, "Mode": int(mode), "Value": value, "Index": index}
    assert read(name, can_id, data) == fields
    assert DATABASES[name].encode_message(can_id, fields, scaling=False) == data
    assert decode_request(data) == (number, mode, value, index)


@given(NAMES, WHERE, EIGHT)
def test_answers(name: str, address: int, data: bytes) -> None:
    can_id = frame_ids(PROFILES[name].ids, address).answer
    fields = read(name, can_id, data)
    answer = decode_answer(data)
    assert answer == Answer(
        fields["Number"], AnswerStatus(fields["Result"]), fields["Value"], fields["Index"]
    )
    assert encode_answer(can_id, answer).data == data
    assert DATABASES[name].encode_message(can_id, fields, scaling=False) == data


@given(NAMES, WHERE, st.integers(0, 255), st.integers(0, 255), st.integers(0, 0xFFFF))
def test_error_frames(name: str, address: int, code: int, location: int, hours: int) -> None:
    profile = PROFILES[name]
    can_id = frame_ids(profile.ids, address).error
    data = encode_error(can_id, profile.error_frame, code, location, hours).data
    assert read(name, can_id, data) == {"Code": code, "Location": location, "Hours": hours}
    report = decode_error(profile.error_frame, data)
    assert (report.code, report.location, report.hours) == (code, location, hours)


@given(NAMES, st.integers(0, 255))
def test_system_frames(name: str, byte: int) -> None:
    frame = encode_system(PROFILES[name].ids, byte)
    assert read(name, frame.can_id, frame.data) == {"Start": byte}
