"""The platform's IMU as a sensor node on CAN: two frames a sample, gyro then accelerometer.

Layout of both (little endian, [M]: chosen for hil, no vendor's): int16 x, y, z and a uint16 counter that
grows by one a sample, so that a lost frame is seen and the two frames of a sample find each other.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from hil.errors import ProtocolError
from hil.frames import Frame
from hil.signals import IMU_QUANTITIES, Sample

GYRO_LSB: Final = 1.0e-4
"""rad/s per increment: ±3.27 rad/s of range, far beyond any motion platform."""
ACCEL_LSB: Final = 2.5e-3
"""m/s² per increment: ±81.9 m/s², beyond the end stops' shocks worth resolving."""

_LAYOUT: Final = struct.Struct("<hhhH")
_RANGE: Final = 32767


@dataclass(frozen=True, slots=True)
class ImuReading:
    """One frame's three values, SI, and its counter."""

    is_gyro: bool
    values: tuple[float, float, float]
    counter: int


def encode(
    base_id: int, gyro: Sequence[float], accel: Sequence[float], counter: int
) -> list[Frame]:
    """The two frames of one sample; values beyond the range saturate, as the sensor's do."""
    return [
        Frame(base_id, _LAYOUT.pack(*(_count(v, GYRO_LSB) for v in gyro), counter & 0xFFFF)),
        Frame(base_id + 1, _LAYOUT.pack(*(_count(v, ACCEL_LSB) for v in accel), counter & 0xFFFF)),
    ]


def decode(base_id: int, frame: Frame) -> ImuReading:
    """What a frame of the node says; ProtocolError if it is none of its frames."""
    is_gyro = frame.can_id == base_id
    if frame.is_extended or frame.is_remote or frame.is_error or len(frame.data) != _LAYOUT.size:
        raise ProtocolError(f"IMU frame {frame} is not a plain frame of {_LAYOUT.size} bytes")
    if not is_gyro and frame.can_id != base_id + 1:
        raise ProtocolError(f"frame {frame} is not from the IMU at {base_id:#x}")
    x, y, z, counter = _LAYOUT.unpack(frame.data)
    lsb = GYRO_LSB if is_gyro else ACCEL_LSB
    return ImuReading(is_gyro, (x * lsb, y * lsb, z * lsb), counter)


def lost_between(before: int, counter: int) -> int:
    """Frames lost between two 16-bit counters; none where it came twice or the node began anew."""
    missing = (counter - before - 1) & 0xFFFF
    return missing if missing < 0x8000 else 0


class ImuReceiver:
    """Turns the node's frames into samples and counts what was lost or malformed.

    `delay_s` is the sensor's own, its filter's group delay: what is received now held so long ago.
    """

    def __init__(self, base_id: int, delay_s: float) -> None:
        self.base_id = base_id
        self.delay_s = delay_s
        self.received = 0
        self.lost = 0
        self.malformed = 0
        self.last_s: float | None = None
        self._counter: dict[bool, int] = {}

    def on_frame(self, now_s: float, frame: Frame) -> list[Sample]:
        """The three samples of a frame of ours; none for any other frame."""
        if frame.can_id not in (self.base_id, self.base_id + 1):
            return []
        try:
            reading = decode(self.base_id, frame)
        except ProtocolError:
            self.malformed += 1
            return []
        before = self._counter.get(reading.is_gyro)
        if before is not None:
            self.lost += lost_between(before, reading.counter)
        self._counter[reading.is_gyro] = reading.counter
        self.received += 1
        self.last_s = now_s
        names = IMU_QUANTITIES[:3] if reading.is_gyro else IMU_QUANTITIES[3:]
        sampled_s = now_s - self.delay_s
        return [
            Sample("imu", name, value, sampled_s, now_s)
            for name, value in zip(names, reading.values, strict=True)
        ]


def _count(value: float, lsb: float) -> int:
    return max(-_RANGE, min(_RANGE, round(value / lsb)))
