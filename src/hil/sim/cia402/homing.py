"""How a simulated CiA 402 drive finds its zero: towards a limit switch, and back until it lets go.

Methods (0x6098, CiA 402-2, homing) [M]: 17 and 18 search the negative and the positive limit switch at the
first speed of 0x6099, leave it at the second, and stand on the edge; 35 and 37 take the present position.
Speeds change by 0x609A. At the zero found the position is the home offset (0x607C). Other methods, and starts
with an acceleration or a speed of zero, end in a homing error (bit 13).
"""

from __future__ import annotations

import math
from typing import Final, Literal

from hil.drives.cia402.mapping import HOMING_MODE
from hil.drives.cia402.profile import Cia402Profile
from hil.sim.cia402.motion import Motion402
from hil.sim.cia402.objects import Objects
from hil.sim.plant import Plant

TARGET_REACHED: Final = 0x0400
ATTAINED: Final = 0x1000
ERROR: Final = 0x2000
HERE: Final = (35, 37)
SWITCHES: Final = {17: -1.0, 18: 1.0}
"""Method, and the direction in which its switch is."""
STEP_S: Final = 0.001
"""Between two points of the path."""

Phase = Literal["none", "search", "leave", "stop"]


class Homing:
    """The search of drive `i`. `is_referenced` says that its positions count from the zero found."""

    def __init__(
        self, plant: Plant, i: int, objects: Objects, motion: Motion402, profile: Cia402Profile
    ) -> None:
        self._plant, self._i, self._objects, self._motion = plant, i, objects, motion
        self._counts = motion.counts_per_unit
        low, high = plant.rig.actuators[i].stroke
        inside = profile.simulated.switches
        self._switch_m = {-1.0: low + inside, 1.0: high - inside}
        self._phase: Phase = "none"
        self._is_absolute = profile.homing.kind == "absolute"
        self.restart()

    def restart(self) -> None:
        """As after power-on: an incremental encoder counts from where it stands."""
        self.is_referenced = self._is_absolute
        self._motion.zero_m = 0.0 if self._is_absolute else self._plant.position(self._i)
        self._bits = 0
        self.stop()

    @property
    def status_bits(self) -> int:
        """What status bits 10, 12 and 13 say in homing mode."""
        return self._bits if self._objects.value(0x6060) == HOMING_MODE else 0

    @property
    def next_due_s(self) -> float:
        """When the path has its next point, s."""
        return self._due_s

    def start(self, now_s: float) -> None:
        """Bit 4 of the control word has risen."""
        method = self._objects.value(0x6098)
        self._bits, self._way = 0, SWITCHES.get(method, 0.0)
        if method in HERE:
            self._found(now_s)
        elif not self._way or not self._speed(1) or not self._speed(2) or not self._rate:
            self._bits = ERROR
        else:
            self._phase = "search"
            self._path_m, self._path_speed = self._plant.position(self._i), 0.0
            self._due_s = now_s + STEP_S

    def stop(self) -> None:
        """Nothing is searched any more."""
        self._phase = "none"
        self._due_s = math.inf

    def on_time(self, now_s: float) -> None:
        """One more point of the path, where it is due."""
        if now_s < self._due_s:
            return
        self._plant.advance(now_s)
        self._look(now_s)
        wanted = {"search": self._way * self._speed(1), "leave": -self._way * self._speed(2)}
        change = self._rate * STEP_S
        off = wanted.get(self._phase, 0.0) - self._path_speed
        self._path_speed += min(max(off, -change), change)
        self._path_m += self._path_speed * STEP_S
        self._motion.go(self._path_m, now_s)
        self._due_s = now_s + STEP_S
        if self._phase == "stop" and self._path_speed == 0.0:
            self._bits |= ATTAINED | TARGET_REACHED
            self.stop()

    def _look(self, now_s: float) -> None:
        """At the switch."""
        beyond = self._way * (self._plant.position(self._i) - self._switch_m.get(self._way, 0.0))
        if self._phase == "search" and beyond >= 0.0:
            self._phase = "leave"
        elif self._phase == "leave" and beyond < 0.0 and self._path_speed * self._way < 0.0:
            self._phase = "stop"
            self._refer()

    def _found(self, now_s: float) -> None:
        self._plant.advance(now_s)
        self._refer()
        self._bits = ATTAINED | TARGET_REACHED

    def _refer(self) -> None:
        offset_m = self._objects.value(0x607C) / self._counts
        self._motion.zero_m = self._plant.position(self._i) - offset_m
        self.is_referenced = True

    def _speed(self, sub: int) -> float:
        return self._objects.value(0x6099, sub) / self._counts

    @property
    def _rate(self) -> float:
        return self._objects.value(0x609A) / self._counts
