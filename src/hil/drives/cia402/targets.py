"""What a CiA 402 drive is told each cycle, and for which SYNC its answer holds."""

from __future__ import annotations

import math
from collections import deque
from typing import Final

from hil.config import RigFile
from hil.drives.cia402.mapping import Units
from hil.drives.meaning import SetpointKind

LATEST_CYCLES: Final = 1.25
"""A busy bus may carry an answer after the next SYNC, but not much."""
SHORTEST_ANSWER_BITS: Final = 47 + 111
"""SYNC and an answer of eight bytes without stuff bits: nothing answers a SYNC sooner."""


class Targets:
    """Setpoints of one drive in its own units. `position`: what it answered last, increments."""

    def __init__(self, rig: RigFile, i: int, kind: SetpointKind) -> None:
        self._actuator, self._kind = rig.actuators[i], kind
        self._units = Units(self._actuator)
        self._cycle_s = rig.bus.cycle
        self._reference = 0.0
        self._before: float | None = None
        self._told = 0.0

    def restart(self) -> None:
        """No setpoint came before."""
        self._before, self._told = None, 0.0

    def idle(self, position: int) -> float:
        """What moves nothing when the power comes: where the drive is, or no force, or no speed."""
        self._before, self._told = None, 0.0
        self._reference = float(position) if self._kind == "position" else 0.0
        return self._reference

    def of(self, setpoint: float | None, position: int) -> float:
        """The target for a setpoint in SI; None holds the last one."""
        if setpoint is None or not math.isfinite(setpoint):
            if self._kind != "velocity" or self._before is None:
                return self._reference
            setpoint = self._before
        if self._kind == "velocity":
            self._reference = self._units.raw("velocity", self._speed(setpoint, position))
        else:
            self._reference = self._units.raw(self._kind, setpoint)
        return self._reference

    def _speed(self, wanted: float, position: int) -> float:
        """Mode csv: the drive model's position loop, in the daemon, within the drive's acceleration.

        After missed cycles the drive has gone on at the speed before, and the loop asks for more at once.
        """
        a = self._actuator
        measured = self._units.measured("position", position)
        before, self._before = wanted if self._before is None else self._before, wanted
        speed = a.position_gain * (wanted - measured)
        speed += a.velocity_ff * (wanted - before) / self._cycle_s
        speed = min(max(speed, -a.velocity_max), a.velocity_max)
        most = a.acceleration_max * self._cycle_s
        self._told = min(max(speed, self._told - most), self._told + most)
        return self._told


class Syncs:
    """The SYNCs that have not been answered yet."""

    def __init__(self, rig: RigFile, i: int) -> None:
        bitrate = rig.can.bitrates[rig.actuators[i].drive.bus]
        self._bits_s = 47 / bitrate
        self._soonest_s = SHORTEST_ANSWER_BITS / bitrate
        self._latest_s = LATEST_CYCLES * rig.bus.cycle
        self._waiting: deque[float] = deque(maxlen=3)

    def sent(self, now_s: float) -> None:
        """One goes out now."""
        self._waiting.append(now_s)

    def answered(self, now_s: float) -> float:
        """Arrival of the SYNC that an answer holds for: the oldest unanswered one that it can answer."""
        waiting = self._waiting
        while waiting and now_s - waiting[0] > self._latest_s:
            waiting.popleft()
        if not waiting or now_s - waiting[0] < self._soonest_s:
            return now_s
        return waiting.popleft() + self._bits_s
