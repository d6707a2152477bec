"""The sensor nodes of an instrumented bicycle on CAN: inclinometer, two encoders, a panel of buttons.

Four identifiers from the rig file's `sensors.base_id` on: lean, wheel, steer, panel; the IMU is the node of
`hil.drives.imu_node`. Little endian; a counter grows by one a sample, so that a lost frame is seen. Layout
[M]: chosen for hil, no vendor's; `drives/bicycle_nodes/frames.dbc` says the same to other tools.
"""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass
from enum import IntEnum
from typing import Final

from hil.config import BicycleFile
from hil.config.bicycle import BICYCLE
from hil.drives.imu_node import ImuReceiver, lost_between
from hil.errors import ProtocolError
from hil.frames import Frame
from hil.signals import Sample

LEAN_LSB: Final = 1.0e-4
"""rad per increment: a twelve-bit inclinometer of ±20 degrees has 1.7e-4."""

_LEAN: Final = struct.Struct("<hBxH")
_COUNT: Final = struct.Struct("<iH")
_PANEL: Final = struct.Struct("<B")


class Button(IntEnum):
    """What the panel on the handlebar asks for."""

    START = 1
    STOP = 2
    CALIBRATE = 3


@dataclass(frozen=True, slots=True)
class Pressed:
    """A button, when its frame came."""

    t_s: float
    button: Button


def encode_lean(base_id: int, lean: float, counter: int, *, saturated: bool) -> Frame:
    """The inclinometer's frame; rad, to the right positive."""
    count = max(-32767, min(32767, round(lean / LEAN_LSB)))
    return Frame(base_id, _LEAN.pack(count, int(saturated), counter & 0xFFFF))


def encode_wheel(base_id: int, angle: float, steps_per_turn: int, counter: int) -> Frame:
    """The wheel encoder's frame; rad, forward positive; the count runs over at 32 bits."""
    return _encoder(base_id + 1, angle, steps_per_turn, counter)


def encode_steer(base_id: int, angle: float, steps_per_turn: int, counter: int) -> Frame:
    """The steer encoder's frame; rad, to the left positive."""
    return _encoder(base_id + 2, angle, steps_per_turn, counter)


def encode_button(base_id: int, button: Button) -> Frame:
    """The panel's frame."""
    return Frame(base_id + 3, _PANEL.pack(button))


def _encoder(can_id: int, angle: float, steps_per_turn: int, counter: int) -> Frame:
    count = round(angle * steps_per_turn / (2.0 * math.pi))
    wrapped = (count + 2**31) % 2**32 - 2**31
    return Frame(can_id, _COUNT.pack(wrapped, counter & 0xFFFF))


class NodeClock:
    """When a free-running node sampled, from its counter: receivers wait, and frames come in bursts.

    Sample n is taken at n · period plus an offset that is never later than any receipt; it may grow by
    DRIFT, so that a node whose clock is slow is followed.
    """

    DRIFT: Final = 3e-4
    LOST_S: Final = 0.5
    """A counter this far behind its period has started anew or keeps another rate: its stamps count."""

    def __init__(self, period_s: float) -> None:
        self._period_s = period_s
        self._offset_s: float | None = None
        self._samples = 0
        self._last_s = -math.inf

    def sampled_s(self, advance: int, received_s: float) -> float:
        """Instant of the sample `advance` counts after the last one; instants always rise."""
        self._samples += advance
        at_s = self._samples * self._period_s
        late_s = received_s - at_s
        if self._offset_s is None or abs(late_s - self._offset_s) > self.LOST_S:
            self._offset_s = late_s
        grown_s = self._offset_s + self.DRIFT * advance * self._period_s
        self._offset_s = min(grown_s, late_s)
        self._last_s = max(at_s + self._offset_s, self._last_s + 1e-5)
        return self._last_s


class NodesReceiver:
    """Turns the nodes' frames into samples and buttons; counts what was lost, malformed, saturated."""

    def __init__(self, rig: BicycleFile) -> None:
        self._base_id = rig.sensors.base_id
        self._step = 2.0 * math.pi / rig.sensors.steps_per_turn
        delay = 0.0 if rig.imu is None else rig.imu.delay + rig.imu.group_delay_s
        self.imu = ImuReceiver(rig.can.imu_base_id, delay)
        self.received: dict[str, int] = {"lean": 0, "rear_wheel": 0, "steer": 0}
        self.lost: dict[str, int] = {"lean": 0, "rear_wheel": 0, "steer": 0}
        self.saturated = 0
        self.malformed = 0
        self._counter: dict[str, int] = {}
        self._clocks = {s: NodeClock(1.0 / rig.rate) for s in self.received}
        self._turned: dict[str, tuple[int, int]] = {}

    def on_frame(self, now_s: float, frame: Frame) -> list[Sample | Pressed]:
        """What a frame of the nodes says; nothing for any other frame."""
        kind = frame.can_id - self._base_id
        if not 0 <= kind <= 3:
            return list(self.imu.on_frame(now_s, frame))
        try:
            if kind == 3:
                return [Pressed(now_s, _button(frame))]
            return [self._sample(kind, now_s, frame)]
        except ProtocolError:
            self.malformed += 1
            return []

    def _sample(self, kind: int, now_s: float, frame: Frame) -> Sample:
        signal = ("lean", "rear_wheel", "steer")[kind]
        layout = _LEAN if kind == 0 else _COUNT
        if len(frame.data) != layout.size or frame.is_remote or frame.is_error or frame.is_extended:
            raise ProtocolError(
                f"{signal} frame {frame} is not a plain frame of {layout.size} bytes"
            )
        if kind == 0:
            count, flags, counter = layout.unpack(frame.data)
            self.saturated += flags & 1
            value = count * LEAN_LSB
        else:
            count, counter = layout.unpack(frame.data)
            value = self._unwrapped(signal, count) * self._step
        before = self._counter.get(signal)
        advance = 1 if before is None else ((counter - before - 1) & 0xFFFF) + 1
        self.lost[signal] += 0 if before is None else lost_between(before, counter)
        self._counter[signal] = counter
        self.received[signal] += 1
        return Sample(BICYCLE, signal, value, self._clocks[signal].sampled_s(advance, now_s), now_s)

    def _unwrapped(self, signal: str, count: int) -> int:
        """The count without the jumps where 32 bits run over."""
        last, turns = self._turned.get(signal, (count, 0))
        if count - last > 2**31:
            turns -= 1
        elif last - count > 2**31:
            turns += 1
        self._turned[signal] = (count, turns)
        return count + turns * 2**32


def _button(frame: Frame) -> Button:
    if len(frame.data) != _PANEL.size:
        raise ProtocolError(f"panel frame {frame} has not one byte")
    try:
        return Button(frame.data[0])
    except ValueError as error:
        raise ProtocolError(f"the panel has no button {frame.data[0]}") from error
