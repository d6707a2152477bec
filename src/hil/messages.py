"""What hil says over Zenoh and keeps in MCAP files: JSON payloads and their JSON Schemas.

Every payload is one struct; what arrives is decoded by `decode`, which turns garbage into a
ProtocolError sentence. Coordinates and actuators are named, never numbered: a client in any
language needs no table of ours. Angles in rad, lengths in m, forces in N (N·m for rotary
actuators), times in s.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from numbers import Real
from typing import Annotated, Any, Final, TypeVar

import msgspec
from msgspec import Meta, Struct

from hil.errors import ProtocolError
from hil.signals import Cue, TimedPose

LARGEST_PAYLOAD: Final = 65_536
"""Bytes; longer payloads are refused unread, so that no client can stall the gateway."""

MOST_POSES: Final = 256
"""Poses in one cue; the rig file's `cue.future` bounds how far ahead they may reach."""


class CueMessage(Struct, frozen=True, forbid_unknown_fields=True):
    """A motion cue: `hil/<rig>/cue`, topic `/cue`.

    `poses` holds one or many poses by coordinate name, each asked for `dt` s after `t`, the
    client's own clock; `seq` grows by one from message to message.
    """

    seq: Annotated[int, Meta(ge=0, le=2**53)]
    t: float
    poses: list[dict[str, float]]


class ActuatorState(Struct, frozen=True, omit_defaults=True):
    """One actuator as last answered; what never was is left out. `age_s` is the position's."""

    position: float | None = None
    velocity: float | None = None
    force: float | None = None
    age_s: float | None = None


class StateMessage(Struct, frozen=True):
    """The rig: `hil/<rig>/state`, topic `/state`. `fault` is empty where there is none.

    `pose` is the measured pose, `setpoint` the one asked for now, each by coordinate, empty until
    known. `tracking_error` is the largest |setpoint - position| of the actuators, m or rad, 0 until
    all have answered. `lateness_s` is how late the loop woke for this cycle, `period_s` the cycle
    just measured, `overruns` the cycles missed since start, `slot_use` the share of parameter slots
    that carried a pair, `bus_load` the share of bit times used.
    """

    t: float
    state: str
    pose: dict[str, float]
    setpoint: dict[str, float]
    actuators: dict[str, ActuatorState]
    tracking_error: float
    fault: str
    lateness_s: float = 0.0
    period_s: float = 0.0
    overruns: int = 0
    slot_use: float = 0.0
    bus_load: float = 0.0


class EventMessage(Struct, frozen=True):
    """Something worth telling a person: `hil/<rig>/event`, topic `/event`."""

    t: float
    severity: str
    name: str
    text: str


class DriveMessage(Struct, frozen=True, omit_defaults=True):
    """One answer of a drive: `hil/<rig>/drive/<actuator>`, topic `/drive/<actuator>`.

    `t` is when its frame was received, `sampled` when the value held. Only what the frame said is
    there.
    """

    t: float
    sampled: float | None = None
    position: float | None = None
    velocity: float | None = None
    force: float | None = None
    current: float | None = None


class DriveStatusMessage(Struct, frozen=True):
    """A drive's status when it changes: `hil/<rig>/drive/<actuator>/status`.

    `phase`: absent, logged on, configured, ready, enabled or fault; `enabled`: it makes force;
    `error` is empty where there is none.
    """

    t: float
    phase: str
    enabled: bool
    error: str


class ImuMessage(Struct, frozen=True, omit_defaults=True):
    """Angular rate and specific force in the sensor frame as a frame brought them: topic `/imu`."""

    t: float
    sampled: float | None = None
    gyro_x: float | None = None
    gyro_y: float | None = None
    gyro_z: float | None = None
    accel_x: float | None = None
    accel_y: float | None = None
    accel_z: float | None = None


class RideMessage(Struct, frozen=True, omit_defaults=True):
    """What a bicycle's sensors measured, rad: `hil/<rig>/ride`, topic `/ride`.

    Lean to the right and steer to the left are positive; `rear_wheel` counts from the start.
    """

    t: float
    sampled: float | None = None
    lean: float | None = None
    rear_wheel: float | None = None
    steer: float | None = None


class SetpointMessage(Struct, frozen=True):
    """Setpoints at the instant their frames were sent, by actuator: topic `/setpoint`.

    `kind` is "position" (m, rad) or "force" (N, N·m).
    """

    t: float
    kind: str
    values: dict[str, float]


class CommandRequest(Struct, frozen=True, forbid_unknown_fields=True):
    """What a client sends with a command query `hil/<rig>/command/<name>`; may be left out."""

    client: str = ""
    arguments: dict[str, float | str | bool] = {}


class CommandReply(Struct, frozen=True, omit_defaults=True):
    """The answer to a command: whether it was carried out, and a sentence.

    `folder` is the run folder that is being recorded, where that was asked for.
    """

    ok: bool
    message: str
    folder: str = ""


M = TypeVar("M", bound=Struct)

PAYLOADS: Final[dict[str, type[Struct]]] = {
    "cue": CueMessage,
    "state": StateMessage,
    "event": EventMessage,
    "drive": DriveMessage,
    "drive_status": DriveStatusMessage,
    "imu": ImuMessage,
    "ride": RideMessage,
    "setpoint": SetpointMessage,
    "command_request": CommandRequest,
    "command_reply": CommandReply,
}
"""Every payload by the name of its schema: `hil/<rig>/schema/<name>`."""


def encode(message: Struct) -> bytes:
    """JSON of a message; numbers of numpy are numbers."""
    return msgspec.json.encode(message, enc_hook=_plain)


def _plain(value: object) -> float:
    if isinstance(value, Real):
        return float(value)
    raise TypeError(f"{type(value).__name__} has no place in a message")


_DECODERS: Final = {kind: msgspec.json.Decoder(kind) for kind in PAYLOADS.values()}
_NAMES: Final = {kind: name for name, kind in PAYLOADS.items()}


def decode(payload: bytes, kind: type[M]) -> M:
    """The message in `payload`; ProtocolError says what is wrong with it and where."""
    name = _NAMES[kind].replace("_", " ")
    if len(payload) > LARGEST_PAYLOAD:
        raise ProtocolError(f"{name}: {len(payload)} bytes, at most {LARGEST_PAYLOAD} are read")
    try:
        message = _DECODERS[kind].decode(payload)
    except (msgspec.DecodeError, UnicodeDecodeError) as error:
        text = str(error).replace("`$.", "`").replace("[...]", " (one of its values)")
        raise ProtocolError(f"{name}: {_lowered(text)}") from error
    except RecursionError as error:
        raise ProtocolError(f"{name}: nested too deeply") from error
    assert isinstance(message, kind)
    return message


def _lowered(sentence: str) -> str:
    return sentence if sentence.startswith("JSON") else sentence[0].lower() + sentence[1:]


def decode_cue(payload: bytes, coordinates: Sequence[str], client: str, received_s: float) -> Cue:
    """The cue in `payload`, poses in the order of `coordinates`.

    ProtocolError for bad JSON, wrong types, numbers that are not finite, unknown or missing
    coordinates, no pose at all, and `dt` that is negative or does not grow.
    """
    return cue_from_message(decode(payload, CueMessage), coordinates, client, received_s)


def cue_from_message(
    message: CueMessage, coordinates: Sequence[str], client: str, received_s: float
) -> Cue:
    """`message` as a Cue, checked as `decode_cue` says."""
    if not 1 <= len(message.poses) <= MOST_POSES:
        raise ProtocolError(f"cue: has {len(message.poses)} poses, 1 to {MOST_POSES} are taken")
    if not math.isfinite(message.t):
        raise ProtocolError("cue: t is not a finite number")
    wanted = {"dt", *coordinates}
    poses: list[TimedPose] = []
    for i, pose in enumerate(message.poses):
        _check_pose(pose, i, wanted, coordinates)
        if pose["dt"] < 0.0 or (poses and pose["dt"] <= poses[-1].dt_s):
            raise ProtocolError(
                f"cue: poses[{i}].dt is {pose['dt']} s; dt starts at 0 or later and grows"
            )
        poses.append(TimedPose(pose["dt"], tuple(pose[name] for name in coordinates)))
    return Cue(client, message.seq, message.t, received_s, tuple(poses))


def _check_pose(
    pose: dict[str, float], i: int, wanted: set[str], coordinates: Sequence[str]
) -> None:
    known = ", ".join(coordinates)
    for name, value in pose.items():
        if name not in wanted:
            raise ProtocolError(
                f"cue: poses[{i}] names {name!r}, which this rig has not; it has dt, {known}"
            )
        if not math.isfinite(value):
            raise ProtocolError(f"cue: poses[{i}].{name} is not a finite number")
    missing = wanted - pose.keys()
    if missing:
        raise ProtocolError(
            f"cue: poses[{i}] lacks {', '.join(sorted(missing))}; each pose names dt, {known}"
        )


def cue_message(cue: Cue, coordinates: Sequence[str]) -> CueMessage:
    """`cue` as the message that a client sends."""
    poses = [{"dt": p.dt_s, **dict(zip(coordinates, p.pose, strict=True))} for p in cue.poses]
    return CueMessage(cue.seq, cue.t_client_s, poses)


def schemas(
    coordinates: Sequence[str] = (), actuators: Sequence[str] = ()
) -> dict[str, dict[str, Any]]:
    """JSON Schema of every payload, by its name in `PAYLOADS`.

    With the names of a rig's coordinates and actuators, the open tables list just those, so that
    Foxglove and PlotJuggler offer each value by name. Written without references and unions, which
    Foxglove does not read: values that may be left out are simply not required.
    """
    kinds = tuple(PAYLOADS.values())
    refs, parts = msgspec.json.schema_components(kinds, ref_template="{name}")
    found = {name: _inlined(ref, parts) for name, ref in zip(PAYLOADS.keys(), refs, strict=True)}
    if coordinates:
        for key in ("pose", "setpoint"):
            _name_keys(found["state"]["properties"][key], coordinates, required=False)
        _name_keys(
            found["cue"]["properties"]["poses"]["items"], ("dt", *coordinates), required=True
        )
    if actuators:
        _name_keys(found["state"]["properties"]["actuators"], actuators, required=False)
        _name_keys(found["setpoint"]["properties"]["values"], actuators, required=False)
    return found


def _inlined(node: Any, parts: dict[str, Any]) -> Any:
    if isinstance(node, list):
        return [_inlined(item, parts) for item in node]
    if not isinstance(node, dict):
        return node
    if "$ref" in node:
        return _inlined(parts[node["$ref"]], parts)
    if "anyOf" in node:
        real = [option for option in node["anyOf"] if option.get("type") != "null"]
        if len(real) == 1:
            return _inlined(real[0], parts)
    node = {k: _inlined(v, parts) for k, v in node.items() if not (k == "default" and v is None)}
    if isinstance(node.get("description"), str):
        node["description"] = " ".join(node["description"].split())
    return node


def _name_keys(table: dict[str, Any], names: Sequence[str], *, required: bool) -> None:
    value = table.pop("additionalProperties")
    table["properties"] = dict.fromkeys(names, value)
    table["additionalProperties"] = False
    if required:
        table["required"] = list(names)
