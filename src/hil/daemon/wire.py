"""The bytes of the records between control and gateway process: fixed-size, versioned, pure.

A datagram is two bytes (magic, version) and then records, each a type byte and a body of the size
that this type always has. `decode` raises ProtocolError on anything that `encode` would not have
made, and on cues with numbers that are not finite.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Iterable
from typing import Any, Final

from hil import frames
from hil.daemon.records import (
    DRIVE_PHASES,
    INPUTS,
    KINDS,
    MAX_AXES,
    NO_FRAME,
    POSES_PER_RECORD,
    QUANTITIES,
    RIG_STATES,
    SEVERITIES,
    ActuatorState,
    CommandRecord,
    CueRecord,
    DriveRecord,
    EventRecord,
    FrameRecord,
    GatewayAlive,
    InputRecord,
    Record,
    ReplyRecord,
    SampleRecord,
    SetpointRecord,
    StateRecord,
)
from hil.errors import ProtocolError

MAGIC: Final = 0x48
VERSION: Final = 2
TEXT_BYTES: Final = 240
REPLY_BYTES: Final = 960
NAME_BYTES: Final = 48
FAULT_BYTES: Final = 120
CLIENT_BYTES: Final = 32


def cut(text: str, size: int) -> bytes:
    """UTF-8 of `text` in at most `size` bytes, never ending inside a character."""
    return text.encode("utf-8", "replace")[:size].decode("utf-8", "ignore").encode()


def _text(raw: bytes) -> str:
    try:
        return raw.rstrip(b"\0").decode()
    except UnicodeDecodeError as error:
        raise ProtocolError("a text in a record is no UTF-8") from error


def _code(table: tuple[str, ...], name: str) -> int:
    try:
        return table.index(name)
    except ValueError:
        raise ProtocolError(f"{name!r} is none of {', '.join(table)}") from None


def _name(table: tuple[str, ...], code: int) -> Any:
    if code >= len(table):
        raise ProtocolError(f"code {code} is outside {', '.join(table)}")
    return table[code]


def _padded(values: tuple[float, ...], what: str) -> tuple[float, ...]:
    if len(values) > MAX_AXES:
        raise ProtocolError(f"{what} has {len(values)} values, at most {MAX_AXES} fit")
    return (*values, *(0.0,) * (MAX_AXES - len(values)))


def _count(n: int, limit: int, what: str) -> int:
    if n > limit:
        raise ProtocolError(f"a record says {n} {what}, at most {limit} fit")
    return n


_FRAME = struct.Struct("<d?B16s")
_STATE = struct.Struct(f"<dBBB{2 * MAX_AXES}d{5 * MAX_AXES}ddddQQQQd{FAULT_BYTES}s")
_SAMPLE = struct.Struct("<BBddd")
_SETPOINT = struct.Struct("<dBBd")
_DRIVE = struct.Struct(f"<dBB?{FAULT_BYTES}s")
_EVENT = struct.Struct(f"<dB{NAME_BYTES}s{TEXT_BYTES}s")
_REPLY = struct.Struct(f"<I?{REPLY_BYTES}s")
_CUE = struct.Struct(f"<{CLIENT_BYTES}sQddHHBB{POSES_PER_RECORD * (1 + MAX_AXES)}d")
_COMMAND = struct.Struct(f"<I{NAME_BYTES}s{NAME_BYTES}s")
_INPUT = struct.Struct("<QdBB16s")
_ALIVE = struct.Struct("<d?")
_NO_FRAME: Final = frames.pack(NO_FRAME)


def _frame(raw: bytes, bus: int) -> frames.Frame:
    if raw == _NO_FRAME and not bus:
        return NO_FRAME
    frame = frames.unpack(raw)
    return frame._replace(bus=bus) if bus else frame


def _pack_frame(r: FrameRecord) -> bytes:
    return _FRAME.pack(r.t_s, r.is_sent, r.frame.bus, frames.pack(r.frame))


def _unpack_frame(body: bytes) -> FrameRecord:
    t_s, is_sent, bus, raw = _FRAME.unpack(body)
    return FrameRecord(t_s, is_sent, _frame(raw, bus))


def _pack_state(r: StateRecord) -> bytes:
    if len(r.setpoint) != len(r.pose):
        raise ProtocolError(f"pose has {len(r.pose)} values, setpoint {len(r.setpoint)}")
    if len(r.actuators) > MAX_AXES:
        raise ProtocolError(f"{len(r.actuators)} actuators, at most {MAX_AXES} fit")
    flat = [value for actuator in r.actuators for value in actuator]
    flat += [0.0] * (5 * MAX_AXES - len(flat))
    return _STATE.pack(
        r.t_s, _code(RIG_STATES, r.state), len(r.pose), len(r.actuators),
        *_padded(r.pose, "pose"), *_padded(r.setpoint, "setpoint"), *flat,
        r.tracking_error, r.lateness_s, r.period_s,
        r.cycles, r.overruns, r.slots, r.pairs, r.bus_load, cut(r.fault, FAULT_BYTES),
    )  # fmt: skip


def _unpack_state(body: bytes) -> StateRecord:
    t_s, code, n, m, *rest = _STATE.unpack(body)
    _count(n, MAX_AXES, "coordinates")
    _count(m, MAX_AXES, "actuators")
    first = 2 * MAX_AXES
    actuators = tuple(ActuatorState(*rest[k : k + 5]) for k in range(first, first + 5 * m, 5))
    error, late_s, period_s, cycles, overruns, slots, pairs, load, fault = rest[7 * MAX_AXES :]
    return StateRecord(
        t_s, _name(RIG_STATES, code), tuple(rest[:n]), tuple(rest[MAX_AXES : MAX_AXES + n]),
        actuators, error, late_s, period_s, cycles, overruns, slots, pairs, load, _text(fault),
    )  # fmt: skip


def _pack_sample(r: SampleRecord) -> bytes:
    return _SAMPLE.pack(r.source, _code(QUANTITIES, r.quantity), r.value, r.sampled_s, r.received_s)


def _unpack_sample(body: bytes) -> SampleRecord:
    source, code, value, sampled_s, received_s = _SAMPLE.unpack(body)
    return SampleRecord(source, _name(QUANTITIES, code), value, sampled_s, received_s)


def _pack_setpoint(r: SetpointRecord) -> bytes:
    return _SETPOINT.pack(r.t_s, r.actuator, _code(KINDS, r.kind), r.value)


def _unpack_setpoint(body: bytes) -> SetpointRecord:
    t_s, actuator, code, value = _SETPOINT.unpack(body)
    return SetpointRecord(t_s, actuator, _name(KINDS, code), value)


def _pack_drive(r: DriveRecord) -> bytes:
    phase = _code(DRIVE_PHASES, r.phase)
    return _DRIVE.pack(r.t_s, r.actuator, phase, r.enabled, cut(r.error, FAULT_BYTES))


def _unpack_drive(body: bytes) -> DriveRecord:
    t_s, actuator, code, enabled, error = _DRIVE.unpack(body)
    return DriveRecord(t_s, actuator, _name(DRIVE_PHASES, code), enabled, _text(error))


def _pack_event(r: EventRecord) -> bytes:
    name, text = cut(r.name, NAME_BYTES), cut(r.text, TEXT_BYTES)
    return _EVENT.pack(r.t_s, _code(SEVERITIES, r.severity), name, text)


def _unpack_event(body: bytes) -> EventRecord:
    t_s, code, name, text = _EVENT.unpack(body)
    return EventRecord(t_s, _name(SEVERITIES, code), _text(name), _text(text))


def _pack_reply(r: ReplyRecord) -> bytes:
    return _REPLY.pack(r.command_id, r.ok, cut(r.text, REPLY_BYTES))


def _unpack_reply(body: bytes) -> ReplyRecord:
    command_id, ok, text = _REPLY.unpack(body)
    return ReplyRecord(command_id, ok, _text(text))


def _pack_cue(r: CueRecord) -> bytes:
    _count(len(r.poses), POSES_PER_RECORD, "poses")
    n = len(r.poses[0][1]) if r.poses else 0
    flat: list[float] = []
    for dt_s, pose in r.poses:
        if len(pose) != n:
            raise ProtocolError("poses of one cue differ in length")
        flat += (dt_s, *_padded(pose, "pose"))
    flat += [0.0] * (POSES_PER_RECORD * (1 + MAX_AXES) - len(flat))
    return _CUE.pack(
        cut(r.client, CLIENT_BYTES), r.seq, r.t_client_s, r.received_s, r.part, r.parts,
        len(r.poses), n, *flat,
    )  # fmt: skip


def _unpack_cue(body: bytes) -> CueRecord:
    client, seq, t_client_s, received_s, part, parts, many, n, *v = _CUE.unpack(body)
    _count(many, POSES_PER_RECORD, "poses")
    _count(n, MAX_AXES, "coordinates")
    if not part < parts:
        raise ProtocolError(f"a cue says it is part {part} of {parts}")
    if not all(map(math.isfinite, (t_client_s, received_s, *v))):
        raise ProtocolError("a cue holds a number that is not finite")
    poses = tuple(
        (v[k], tuple(v[k + 1 : k + 1 + n])) for k in range(0, many * (1 + MAX_AXES), 1 + MAX_AXES)
    )
    return CueRecord(_text(client), seq, t_client_s, received_s, part, parts, poses)


def _pack_command(r: CommandRecord) -> bytes:
    name, argument = cut(r.name, NAME_BYTES), cut(r.argument, NAME_BYTES)
    return _COMMAND.pack(r.command_id, name, argument)


def _unpack_command(body: bytes) -> CommandRecord:
    command_id, name, argument = _COMMAND.unpack(body)
    return CommandRecord(command_id, _text(name), _text(argument))


def _pack_input(r: InputRecord) -> bytes:
    what = _code(INPUTS, r.what)
    raw = _NO_FRAME if r.frame is NO_FRAME else frames.pack(r.frame)
    return _INPUT.pack(r.number, r.t_s, what, r.frame.bus, raw)


def _unpack_input(body: bytes) -> InputRecord:
    number, t_s, code, bus, raw = _INPUT.unpack(body)
    return InputRecord(number, t_s, _name(INPUTS, code), _frame(raw, bus))


def _pack_alive(r: GatewayAlive) -> bytes:
    return _ALIVE.pack(*r)


def _unpack_alive(body: bytes) -> GatewayAlive:
    return GatewayAlive(*_ALIVE.unpack(body))


_CODECS: Final[dict[int, tuple[type, int, Callable[[Any], bytes], Callable[[bytes], Record]]]] = {
    1: (FrameRecord, _FRAME.size, _pack_frame, _unpack_frame),
    2: (StateRecord, _STATE.size, _pack_state, _unpack_state),
    3: (SampleRecord, _SAMPLE.size, _pack_sample, _unpack_sample),
    4: (SetpointRecord, _SETPOINT.size, _pack_setpoint, _unpack_setpoint),
    6: (EventRecord, _EVENT.size, _pack_event, _unpack_event),
    7: (ReplyRecord, _REPLY.size, _pack_reply, _unpack_reply),
    8: (DriveRecord, _DRIVE.size, _pack_drive, _unpack_drive),
    9: (InputRecord, _INPUT.size, _pack_input, _unpack_input),
    16: (CueRecord, _CUE.size, _pack_cue, _unpack_cue),
    17: (CommandRecord, _COMMAND.size, _pack_command, _unpack_command),
    18: (GatewayAlive, _ALIVE.size, _pack_alive, _unpack_alive),
}
_PACKERS: Final = {cls: (bytes((code,)), pack) for code, (cls, _, pack, _) in _CODECS.items()}
HEADER: Final = bytes((MAGIC, VERSION))


def encode(record: Record) -> bytes:
    """Type byte and body of one record; ProtocolError if a value does not fit its field."""
    code, pack = _PACKERS[type(record)]
    try:
        return code + pack(record)
    except struct.error as error:
        raise ProtocolError(f"{type(record).__name__} does not fit its record: {error}") from error


def datagram(encoded: Iterable[bytes]) -> bytes:
    """One datagram of records that `encode` made."""
    return HEADER + b"".join(encoded)


def decode(raw: bytes) -> list[Record]:
    """The records of one datagram; ProtocolError if any of it is not as `encode` makes it."""
    return [record for record, _ in decode_with_bytes(raw)]


def decode_with_bytes(raw: bytes) -> list[tuple[Record, bytes]]:
    """The records of one datagram as `decode` has them, each with what `encode` made of it."""
    if raw[:2] != HEADER:
        raise ProtocolError(
            f"a datagram begins with {raw[:2].hex() or 'nothing'}, not {HEADER.hex()}: are both "
            "processes of the same version of hil?"
        )
    records: list[tuple[Record, bytes]] = []
    at, whole = 2, len(raw)
    while at < whole:
        codec = _CODECS.get(raw[at])
        if codec is None:
            raise ProtocolError(f"a datagram holds a record of unknown type {raw[at]}")
        kind, size, _, unpack = codec
        end = at + 1 + size
        if end > whole:
            raise ProtocolError(f"a {kind.__name__} in a datagram is cut short")
        records.append((unpack(raw[at + 1 : end]), raw[at:end]))
        at = end
    return records
