"""A drive's objects or parameters by name, for both families: what there is, read, write."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from hil.daemon.commission import Desk
from hil.drives.cia402 import codec as canopen
from hil.drives.cia402.mapping import MODE_CODES, supports
from hil.drives.cia402.meaning import number_of, writable_objects
from hil.drives.cia402.profile import Cia402Profile
from hil.drives.cia402.sdo import Transfer
from hil.drives.describe import parameter_names
from hil.drives.driver import PowerGoal
from hil.drives.lust_cdd3000 import codec as lust
from hil.drives.meaning import writable_parameters
from hil.drives.power import decode_status_word
from hil.drives.profile import LustProfile, WireType
from hil.errors import DriveError, ProtocolError
from hil.frames import Frame

ANSWER_S: Final = 0.3
GATE_CYCLES: Final = 25
"""A little more than the gate counts frames over: objects are written one by one, not in a burst."""
TRIES: Final = 3
SHOWN: Final = (
    0x1008,
    0x1009,
    0x100A,
    0x1001,
    0x603F,
    0x6041,
    0x6061,
    0x6064,
    0x606C,
    0x6077,
    0x6502,
)
"""What `info` reads of a CiA 402 drive, where its EDS has it."""

Value = int | float | str | bytes


def read(desk: Desk, name: str) -> tuple[str, Value]:
    """Full name and value of an object; DriveError or ProtocolError say why not."""
    if isinstance(desk.profile, Cia402Profile):
        entry = desk.profile.objects.find(name)
        return str(entry), entry.decode(_transfer(desk, Transfer(entry.index, entry.sub)))
    number, label, kind, scale = _parameter(desk.profile, name)
    return label, lust.from_wire(
        kind, _exchange(desk, lust.Request(number, lust.Mode.READ))
    ) * scale


def write(desk: Desk, name: str, text: str) -> tuple[str, Value]:
    """Write what a person wrote and read it back: full name and value afterwards."""
    if isinstance(desk.profile, Cia402Profile):
        entry = desk.profile.objects.find(name)
        if number_of(entry.index, entry.sub) not in writable_objects(desk.profile):
            raise DriveError(
                f"{entry} is not written from here: it is read-only, or it moves the drive"
            )
        _transfer(desk, Transfer(entry.index, entry.sub, entry.parse(text)))
        return read(desk, name)
    number, label, kind, scale = _parameter(desk.profile, name)
    if number not in writable_parameters(desk.profile.parameters):
        raise DriveError(
            f"{label} is not among the parameters that hil writes: use its maker's program"
        )
    try:
        raw = lust.to_wire(kind, float(text) / scale)
    except ValueError:
        raise ProtocolError(f"{label}: {text!r} is no number") from None
    _exchange(desk, lust.Request(number, lust.Mode.WRITE, raw))
    return read(desk, name)


def info(desk: Desk) -> Iterator[tuple[str, str]]:
    """What a person wants to know first, name and text; what cannot be read says so."""
    profile = desk.profile
    if isinstance(profile, LustProfile):
        for _, label, _, _ in _parameters(profile):
            yield label, _told(desk, label)
        return
    for name, sub in (("vendor", 1), ("product", 2), ("revision", 3), ("serial number", 4)):
        if (0x1018, sub) in profile.objects:
            yield name, _told(desk, f"0x1018:{sub:x}", hexadecimal=True)
    for index in SHOWN:
        if (index, 0) not in profile.objects:
            continue
        entry = profile.objects[index, 0]
        try:
            _, value = read(desk, f"{index:#x}")
        except DriveError as error:
            yield entry.name, str(error)
            continue
        yield entry.name, _meaning(index, value)


def set_up_homing(desk: Desk) -> float:
    """Write mode, method and speeds of the drive file; returns the time it may take, s."""
    profile, actuator = desk.profile, desk.rig.actuators[0]
    assert isinstance(profile, Cia402Profile)
    homing, counts = profile.homing, actuator.drive.counts_per_unit
    for name, value in (
        ("0x6098", homing.method),
        ("0x6099:1", round(homing.speed * counts)),
        ("0x6099:2", round(homing.speed * counts)),
        ("0x609A", round(homing.acceleration * counts)),
        ("0x6060", 6),
    ):
        write(desk, name, str(value))
        desk.run(PowerGoal.OFF, lambda: False, GATE_CYCLES * desk.rig.bus.cycle)
    return homing.timeout


def _told(desk: Desk, name: str, *, hexadecimal: bool = False) -> str:
    try:
        value = read(desk, name)[1]
    except DriveError as error:
        return str(error)
    if isinstance(value, float):
        return f"{value:g}"
    return f"{value:#x}" if hexadecimal and isinstance(value, int) else str(value)


def _meaning(index: int, value: Value) -> str:
    if not isinstance(value, int):
        return str(value)
    if index == 0x6041:
        try:
            return f"{value:#06x} ({decode_status_word(value)})"
        except ProtocolError as error:
            return str(error)
    if index == 0x6502:
        return f"{value:#x} ({', '.join(m for m in MODE_CODES if supports(value, m)) or 'no cyclic mode'})"
    return f"{value:#x}" if index in (0x1001, 0x603F) else str(value)


def _transfer(desk: Desk, transfer: Transfer) -> bytes:
    ids = canopen.node_ids(desk.rig.address(0))
    who = f"{desk.driver.name} (node {desk.rig.address(0)})"

    def take(frame: Frame) -> bool:
        if frame.can_id != ids.sdo_answer:
            return False
        abort = transfer.take(frame.data)
        if abort is not None:
            desk.send(Frame(ids.sdo_request, abort))
        return True

    for _ in range(TRIES):
        while not transfer.is_done and desk.ask(
            Frame(ids.sdo_request, transfer.request), take, ANSWER_S
        ):
            pass
        if transfer.is_done:
            break
    if not transfer.is_done:
        raise DriveError(f"{who} does not answer: {transfer}")
    if transfer.error is not None:
        raise DriveError(f"{who}: {transfer.error}")
    return transfer.result


def _exchange(desk: Desk, request: lust.Request) -> int:
    assert isinstance(desk.profile, LustProfile)
    ids = lust.frame_ids(desk.profile.ids, desk.rig.address(0))
    found: list[lust.Answer] = []

    def take(frame: Frame) -> bool:
        if frame.can_id != ids.answer:
            return False
        answer = lust.decode_answer(frame.data)
        if answer.number == request.number:
            found.append(answer)
        return bool(found)

    for _ in range(TRIES):
        if desk.ask(lust.encode_request(ids.request, request), take, ANSWER_S) and found:
            answer = found.pop()
            if not answer.status & lust.AnswerStatus.REPEAT_ACTION:
                if answer.status:
                    raise DriveError(
                        f"{desk.driver.name}: parameter {request.number}: {answer.status}"
                    )
                return answer.value
    raise DriveError(f"{desk.driver.name} does not answer: parameter {request.number}")


def _parameters(profile: LustProfile) -> list[tuple[int, str, WireType, float]]:
    names = parameter_names(profile.parameters)
    return [(n, label, kind, scale) for n, (label, kind, scale) in sorted(names.items())]


def _parameter(profile: LustProfile, name: str) -> tuple[int, str, WireType, float]:
    for number, label, kind, scale in _parameters(profile):
        if name in (label, str(number)):
            return number, label, kind, scale
    if name.isdigit():
        return int(name), f"parameter {name}", "int32", 1.0
    known = ", ".join(label for _, label, _, _ in _parameters(profile))
    raise ProtocolError(f"{profile.name} has no parameter {name!r}; there are {known}, and numbers")
