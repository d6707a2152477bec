"""Messages: what clients may say, and the sentence that answers everything else."""

from __future__ import annotations

import json
import math
from typing import Any

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hil.errors import ProtocolError
from hil.messages import (
    LARGEST_PAYLOAD,
    PAYLOADS,
    ActuatorState,
    CommandReply,
    CommandRequest,
    CueMessage,
    DriveMessage,
    EventMessage,
    ImuMessage,
    SetpointMessage,
    StateMessage,
    cue_from_message,
    cue_message,
    decode,
    decode_cue,
    encode,
    schemas,
)

COORDINATES = ("yaw", "pitch", "roll")
GOOD = {"seq": 17, "t": 12.345, "poses": [{"dt": 0.0, "roll": 0.02, "pitch": 0.0, "yaw": -0.1}]}


def cue(**changes: Any) -> bytes:
    return json.dumps({**GOOD, **changes}).encode()


def pose(**changes: Any) -> dict[str, Any]:
    return {"dt": 0.0, "roll": 0.0, "pitch": 0.0, "yaw": 0.0, **changes}


def refusal(payload: bytes) -> str:
    with pytest.raises(ProtocolError) as caught:
        decode_cue(payload, COORDINATES, "client", 1.0)
    return str(caught.value)


def test_cue_of_the_contract_is_read_in_the_rigs_order() -> None:
    found = decode_cue(cue(), COORDINATES, "simulator", 3.5)
    assert (found.client, found.seq, found.t_client_s, found.received_s) == (
        "simulator",
        17,
        12.345,
        3.5,
    )
    assert found.poses[0].pose == (-0.1, 0.0, 0.02)


def test_whole_numbers_are_as_good_as_decimals() -> None:
    found = decode_cue(cue(t=12, poses=[pose(roll=0)]), COORDINATES, "c", 0.0)
    assert found.t_client_s == 12.0


@given(
    values=st.lists(
        st.tuples(*[st.floats(-10, 10, allow_nan=False) for _ in COORDINATES]), min_size=1
    ),
    t=st.floats(-1e9, 1e9),
    seq=st.integers(0, 2**53),
)
def test_cue_survives_the_way_to_json_and_back(
    values: list[tuple[float, ...]], t: float, seq: int
) -> None:
    poses = [
        {"dt": 0.01 * i, **dict(zip(COORDINATES, v, strict=True))} for i, v in enumerate(values)
    ]
    read = decode_cue(encode(CueMessage(seq, t, poses)), COORDINATES, "c", 0.0)
    again = decode_cue(encode(cue_message(read, COORDINATES)), COORDINATES, "c", 0.0)
    assert again == read
    assert [p.pose for p in again.poses] == values


@pytest.mark.parametrize(
    ("payload", "sentence"),
    [
        (b"", "cue: input data was truncated"),
        (b"{", "cue: input data was truncated"),
        (b"\xff\xfe\x00", "malformed"),
        (b"null", "expected `object`, got `null`"),
        (b"[" * 60_000, "expected `object`, got `array`"),
        (b'{"seq": 1, "t": NaN, "poses": []}', "malformed"),
        (cue().replace(b"0.02", b"Infinity"), "malformed"),
        (cue().replace(b"0.02", b"1e999"), "out of range"),
        (cue().replace(b"0.02", b"null"), "expected `float`, got `null`"),
        (cue(seq=1.5), "expected `int`, got `float` - at `seq`"),
        (cue(seq=-1), "seq"),
        (cue(seq=10**30), "seq"),
        (cue(t="now"), "expected `float`, got `str` - at `t`"),
        (cue(poses=[]), "has 0 poses, 1 to 256 are taken"),
        (cue(poses=[pose(dt=0.001 * i) for i in range(257)]), "has 257 poses"),
        (cue(poses=[pose(rol=0.0)]), "poses[0] names 'rol', which this rig has not"),
        (cue(poses=[{"dt": 0.0, "roll": 0.0, "yaw": 0.0}]), "poses[0] lacks pitch"),
        (cue(poses=[{"roll": 0.0, "pitch": 0.0, "yaw": 0.0}]), "poses[0] lacks dt"),
        (cue(poses=[pose(roll=True)]), "expected `float`, got `bool`"),
        (cue(poses=[pose(dt=-0.1)]), "poses[0].dt is -0.1 s; dt starts at 0 or later and grows"),
        (cue(poses=[pose(), pose()]), "poses[1].dt is 0.0 s"),
        (cue(speed=3.0), "unknown field `speed`"),
        (b'{"seq": 1, "poses": []}', "missing required field `t`"),
        (b" " * (LARGEST_PAYLOAD + 1), "at most 65536 are read"),
    ],
)
def test_bad_cue_gets_its_sentence(payload: bytes, sentence: str) -> None:
    assert sentence in refusal(payload)


def test_cue_that_python_code_filled_with_nan_is_refused_by_name() -> None:
    message = CueMessage(1, 0.0, [pose(roll=math.nan)])
    with pytest.raises(ProtocolError, match=r"poses\[0\].roll is not a finite number"):
        cue_from_message(message, COORDINATES, "c", 0.0)
    with pytest.raises(ProtocolError, match="t is not a finite number"):
        cue_from_message(CueMessage(1, math.inf, [pose()]), COORDINATES, "c", 0.0)


@given(st.binary(max_size=200))
def test_no_bytes_do_more_than_raise_a_protocol_error(payload: bytes) -> None:
    for kind in PAYLOADS.values():
        try:
            decode(payload, kind)
        except ProtocolError:
            continue


MESSAGES = [
    StateMessage(
        1.0,
        "engaged",
        {"roll": 0.1},
        {"roll": 0.11},
        {"leg1": ActuatorState(0.6, 0.0, 120.0, 0.004), "leg2": ActuatorState()},
        0.01,
        "",
        2e-5,
        0.01,
        0,
        1.0,
        0.31,
    ),
    EventMessage(1.0, "warning", "cue_stale", "no cue for 0.2 s: the rig parks"),
    DriveMessage(1.0, 0.999, position=0.6),
    ImuMessage(1.0, 0.999, gyro_x=0.1, gyro_y=0.0, gyro_z=0.0),
    SetpointMessage(1.0, "position", {"leg1": 0.6}),
    CommandRequest("someone", {"mode": "drive", "force": True, "share": 0.5}),
    CommandReply(True, "armed"),
    CueMessage(1, 0.0, [pose()]),
]


@pytest.mark.parametrize("message", MESSAGES, ids=lambda m: type(m).__name__)
def test_every_message_survives_json(message: msgspec.Struct) -> None:
    assert decode(encode(message), type(message)) == message


def test_numbers_of_numpy_are_numbers() -> None:
    payload = encode(SetpointMessage(np.float64(1.5), "position", {"leg1": np.float32(0.5)}))
    assert decode(payload, SetpointMessage) == SetpointMessage(1.5, "position", {"leg1": 0.5})
    with pytest.raises(TypeError, match="object has no place"):
        encode(SetpointMessage(0.0, "position", {"leg1": object()}))  # type: ignore[dict-item]


def test_what_was_never_measured_is_left_out_rather_than_null() -> None:
    state = json.loads(encode(MESSAGES[0]))
    assert state["actuators"]["leg2"] == {}
    assert state["fault"] == ""
    assert set(json.loads(encode(MESSAGES[2]))) == {"t", "sampled", "position"}


def test_schemas_name_the_rigs_coordinates_and_actuators() -> None:
    found = schemas(COORDINATES, ("leg1", "leg2"))
    state = found["state"]["properties"]
    assert set(state["pose"]["properties"]) == set(COORDINATES)
    assert set(state["actuators"]["properties"]) == {"leg1", "leg2"}
    assert found["cue"]["properties"]["poses"]["items"]["required"] == ["dt", *COORDINATES]
    assert set(found) == set(PAYLOADS)


def test_schemas_use_only_what_foxglove_reads() -> None:
    text = json.dumps(schemas(COORDINATES, ("leg1",)))
    for word in ("$ref", '"null"'):
        assert word not in text
    for name in ("cue", "state", "drive", "imu", "setpoint", "event"):
        assert "anyOf" not in json.dumps(schemas(COORDINATES, ("leg1",))[name])


def test_messages_obey_their_own_schemas() -> None:
    found = schemas(("roll",), ("leg1", "leg2"))
    names = {kind: name for name, kind in PAYLOADS.items()}
    for message in MESSAGES[:-1]:
        schema = found[names[type(message)]]
        data = json.loads(encode(message))
        assert set(schema.get("required", ())) <= set(data)
        assert set(data) <= set(schema["properties"])
