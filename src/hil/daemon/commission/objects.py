"""A drive's objects or parameters by name, for both families: what there is, read, write."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Final

from hil.daemon.commission.access import Access, NoAnswer
from hil.daemon.commission.desk import Desk
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

GATE_CYCLES: Final = 25
"""A little more than the gate counts frames over: objects are written one by one, not in a burst."""
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


def read(drive: Access, name: str) -> tuple[str, Value]:
    """Full name and value of an object; DriveError or ProtocolError say why not."""
    if isinstance(drive.profile, Cia402Profile):
        entry = drive.profile.objects.find(name)
        return str(entry), entry.decode(drive.transfer(Transfer(entry.index, entry.sub)))
    number, label, kind, scale = _parameter(drive.profile, name)
    raw = drive.exchange(lust.Request(number, lust.Mode.READ))
    return label, lust.from_wire(kind, raw) * scale


def write(drive: Access, name: str, text: str) -> tuple[str, Value]:
    """Write what a person wrote and read it back: full name and value afterwards."""
    if isinstance(drive.profile, Cia402Profile):
        entry = drive.profile.objects.find(name)
        if number_of(entry.index, entry.sub) not in writable_objects(drive.profile):
            raise DriveError(
                f"{entry} is not written from here: it is read-only, or it moves the drive"
            )
        drive.transfer(Transfer(entry.index, entry.sub, entry.parse(text)))
        return read(drive, name)
    number, label, kind, scale = _parameter(drive.profile, name)
    if number not in writable_parameters(drive.profile.parameters):
        raise DriveError(
            f"{label} is not among the parameters that hil writes: use its maker's program"
        )
    drive.exchange(lust.Request(number, lust.Mode.WRITE, _raw(label, kind, scale, text)))
    return read(drive, name)


def info(drive: Access) -> Iterator[tuple[str, str]]:
    """What a person wants to know first, name and text; what cannot be read says so.

    NoAnswer where nobody answers at all.
    """
    profile = drive.profile
    if isinstance(profile, LustProfile):
        for _, label, _, _ in _parameters(profile):
            yield label, _told(drive, label)
        return
    for name, sub in (("vendor", 1), ("product", 2), ("revision", 3), ("serial number", 4)):
        if (0x1018, sub) in profile.objects:
            yield name, _told(drive, f"0x1018:{sub:x}", hexadecimal=True)
    for index in SHOWN:
        if (index, 0) not in profile.objects:
            continue
        entry = profile.objects[index, 0]
        try:
            _, value = read(drive, f"{index:#x}")
        except NoAnswer:
            raise
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
        ("0x6099:2", round(homing.speed_to_zero * counts)),
        ("0x607C", round(homing.offset * counts)),
        ("0x609A", round(homing.acceleration * counts)),
        ("0x6060", 6),
    ):
        write(desk.objects, name, str(value))
        desk.run(PowerGoal.OFF, lambda: False, GATE_CYCLES * desk.rig.bus.cycle)
    return homing.timeout


def _told(drive: Access, name: str, *, hexadecimal: bool = False) -> str:
    try:
        value = read(drive, name)[1]
    except NoAnswer:
        raise
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


def _raw(label: str, kind: WireType, scale: float, text: str) -> int:
    """What a person wrote, as it travels; ProtocolError where it would be cut off at the end of the range."""
    try:
        value = float(text)
    except ValueError:
        raise ProtocolError(f"{label}: {text!r} is no number") from None
    if math.isfinite(value):
        raw = lust.to_wire(kind, value / scale)
        if abs(lust.from_wire(kind, raw) * scale - value) <= max(abs(scale), 1e-6 * abs(value)):
            return raw
    raise ProtocolError(f"{label}: {text} does not fit {kind}")


def _parameters(profile: LustProfile) -> list[tuple[int, str, WireType, float]]:
    names = parameter_names(profile.parameters)
    return [(n, label, kind, scale) for n, (label, kind, scale) in sorted(names.items())]


def _parameter(profile: LustProfile, name: str) -> tuple[int, str, WireType, float]:
    for number, label, kind, scale in _parameters(profile):
        if name in (label, str(number)):
            return number, label, kind, scale
    if name.isdecimal() and int(name) in lust.NUMBERS:
        return int(name), f"parameter {name}", "int32", 1.0
    known = ", ".join(label for _, label, _, _ in _parameters(profile))
    raise ProtocolError(
        f"{profile.name} has no parameter {name!r}; there are {known}, and numbers up to {lust.NUMBERS[-1]}"
    )
