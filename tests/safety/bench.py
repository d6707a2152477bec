"""A rig of round numbers for the gate, with frames whose bytes are read at a glance.

Every limit is exact in binary floating point, so "just inside, at, just outside" mean what they say.
In cycles of half a second: velocity_max 20 per cycle (so 21 pass), acceleration_max 20 per cycle² (21 pass,
and two increments' rounding, 2**-9), following_error 50, stroke less margin -100..100, force_max 64,
measurements fresh for 5 cycles.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping
from typing import Any

from hil.drives.meaning import Ask, Meaning
from hil.frames import Frame
from hil.safety.rules import DriveLimits, GateLimits

ON, FORCE, OFF, SPEED, REQUEST, SYSTEM = 0x100, 0x180, 0x200, 0x280, 0x300, 0x080
START, STOP = b"\x01", b"\x00"
START_LEFT = b"\x03"
"""Starts the drives of a family to which only the left one belongs."""
EPS = 2.0**-20
CYCLE_S = 0.5


_ASKS = (
    Ask.POWER_OFF,
    Ask.FAULT_RESET,
    Ask.POWER_ON,
    Ask.NETWORK,
    Ask.SYNC,
    Ask.ALIVE,
)
"""By the first byte of the frame OFF."""


class BenchMeaning:
    """Frames of the bench: a float64 is a setpoint, a request's first byte is its ask."""

    lengths: Mapping[int, int] = {
        SYSTEM: 1,
        **{
            base + i: size
            for i in range(2)
            for base, size in ((ON, 8), (FORCE, 8), (SPEED, 8), (OFF, 1), (REQUEST, 2))
        },
    }

    def writable(self, i: int) -> frozenset[int]:
        return frozenset({7, 8}) if i == 0 else frozenset({8})

    def meaning(self, can_id: int, data: bytes) -> Meaning:
        if can_id == SYSTEM:
            return {
                START: Meaning(Ask.SYSTEM_START),
                STOP: Meaning(Ask.SYSTEM_STOP),
                START_LEFT: Meaning(Ask.SYSTEM_START, actuators=(0,)),
            }.get(data, Meaning(Ask.UNKNOWN, text="neither start nor stop"))
        base, i = can_id & ~0x7F if can_id < FORCE or can_id >= OFF else FORCE, can_id & 0x7F
        if base in (ON, FORCE, SPEED):
            kind = {ON: "position", FORCE: "force", SPEED: "velocity"}[base]
            return Meaning(Ask.POWER_ON, i, kind=kind, setpoint=struct.unpack("<d", data)[0])  # type: ignore[arg-type]
        if base == OFF:
            return Meaning(_ASKS[data[0]], i)
        return Meaning(Ask.WRITE if data[0] else Ask.READ, i, parameter=data[1])


def limits(kind: str = "position", **changed: Any) -> GateLimits:
    """Two drives of round numbers."""
    values: dict[str, Any] = {
        "kind": kind,
        "low_m": -100.0,
        "high_m": 100.0,
        "velocity_max": 20.0 / CYCLE_S,
        "acceleration_max": 20.0 / CYCLE_S**2,
        "force_max_n": 64.0,
        "following_error_m": 50.0,
        "resolution_m": 2.0**-10,
        **changed,
    }
    return GateLimits(
        drives=tuple(DriveLimits(name=name, **values) for name in ("left", "right")),
        cycle_s=CYCLE_S,
        fresh_s=5.0 * CYCLE_S,
    )


def on(value: float, i: int = 0) -> Frame:
    return Frame(ON + i, struct.pack("<d", value))


def force(value: float, i: int = 0) -> Frame:
    return Frame(FORCE + i, struct.pack("<d", value))


def speed(value: float, i: int = 0) -> Frame:
    return Frame(SPEED + i, struct.pack("<d", value))


def network(i: int = 0) -> Frame:
    """A node started, stopped or reset."""
    return Frame(OFF + i, b"\x03")


def sync() -> Frame:
    return Frame(OFF, b"\x04")


def alive() -> Frame:
    return Frame(OFF, b"\x05")


def off(i: int = 0) -> Frame:
    return Frame(OFF + i, b"\x00")


def reset(i: int = 0) -> Frame:
    return Frame(OFF + i, b"\x01")


def bare_on(i: int = 0) -> Frame:
    """Power on without a setpoint."""
    return Frame(OFF + i, b"\x02")


def read(number: int, i: int = 0) -> Frame:
    return Frame(REQUEST + i, bytes([0, number]))


def write(number: int, i: int = 0) -> Frame:
    return Frame(REQUEST + i, bytes([1, number]))


def system(data: bytes) -> Frame:
    return Frame(SYSTEM, data)
