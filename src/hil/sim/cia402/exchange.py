"""The process data of a simulated CiA 402 drive: targets taken, answers given, at SYNC; setpoints missed."""

from __future__ import annotations

import math

from hil.drives.cia402.configure import AT_ONCE, DISABLED
from hil.drives.cia402.mapping import MODE_CODES
from hil.drives.cia402.profile import Cia402Profile
from hil.sim.cia402.motion import Motion402
from hil.sim.cia402.objects import Objects
from hil.sim.cia402.power import PowerStage

PDO_LENGTH, MISSED = 0x8210, 0xFF01
"""Emergency error codes (CiA 301 [M]; the last is the maker's)."""
_CYCLIC = frozenset(MODE_CODES.values())


class ProcessData:
    """What an operational drive does with its PDOs. Its methods return emergency codes to tell."""

    def __init__(
        self,
        objects: Objects,
        motion: Motion402,
        power: PowerStage,
        profile: Cia402Profile,
        cycle_s: float,
        sync_bits_s: float,
    ) -> None:
        self._objects, self._motion, self._power = objects, motion, power
        self._reactions = profile.simulated.missed_setpoints
        self._cycle_s, self._sync_bits_s = cycle_s, sync_bits_s
        self.missed = 0
        """Setpoints missed so far."""
        self.wrong = 0
        """So many of the next answers have another length than is mapped."""
        self.restart()

    def restart(self) -> None:
        """As after power-on."""
        self._target: bytes | None = None
        self.sync_s = -math.inf
        self._in_a_row = 0

    @property
    def is_cyclic(self) -> bool:
        """Whether its mode wants a target each cycle."""
        return self._objects.value(0x6060) in _CYCLIC

    @property
    def late_s(self) -> float:
        """When the next SYNC is missed: half a cycle after it should have come, s."""
        if not self._power.is_on or not self.is_cyclic:
            return math.inf
        return max(self.sync_s, self._power.enabled_s) + 1.5 * self._cycle_s

    def on_sync(self, now_s: float) -> list[int]:
        """A SYNC: the target sent before acts."""
        self.sync_s = now_s
        target, self._target = self._target, None
        is_synchronous = self._objects.value(0x1400, 2) < AT_ONCE - 1
        if target is not None and is_synchronous:
            return self._take(now_s, target, now_s - self._sync_bits_s - self._cycle_s)
        if target is None and self._power.is_on:
            return self.miss(now_s)
        return []

    def on_target(self, now_s: float, data: bytes) -> list[int]:
        """Process data have come."""
        if self._objects.value(0x1400, 1) & DISABLED:
            return []
        if len(data) != sum(e.size or 0 for e in self._objects.mapped(0x1600)):
            return [PDO_LENGTH]
        self._target = data
        if self._objects.value(0x1400, 2) >= AT_ONCE - 1:
            return self._take(now_s, data, now_s - self._motion.senses.frame_s)
        return []

    def answer(self) -> tuple[int, bytes] | None:
        """Identifier and data of the answer to a SYNC; None where none is sent."""
        parameter = self._objects.value(0x1800, 1)
        if parameter & DISABLED or not 1 <= self._objects.value(0x1800, 2) <= 240:
            return None
        if self.wrong > 0:
            self.wrong -= 1
            return parameter & 0x7FF, bytes(3)
        mapped = self._objects.mapped(0x1A00)
        return parameter & 0x7FF, b"".join(self._objects.read(e.index, e.sub) for e in mapped)

    def miss(self, now_s: float) -> list[int]:
        """One more setpoint did not come in time."""
        self.missed += 1
        self._in_a_row += 1
        reaction = self._reactions[min(self._in_a_row, len(self._reactions)) - 1]
        if reaction == "fault":
            return [MISSED] if self._power.trip(now_s, MISSED) else []
        self._motion.missed(reaction, now_s - self._cycle_s)
        return []

    def _take(self, now_s: float, data: bytes, at_s: float) -> list[int]:
        """Process data act: control word first, then the target of the mode."""
        self._in_a_row = 0
        word: int | None = None
        for entry in self._objects.mapped(0x1600):
            size = entry.size or 0
            part, data = data[:size], data[size:]
            value = entry.decode(part)
            assert isinstance(value, int)
            self._objects.put((entry.index, entry.sub), value)
            if entry.index == 0x6040:
                word = value
        if word is not None:
            self._power.obey(now_s, word)
        if self._power.is_on and self.is_cyclic:
            self._motion.target(self._objects, at_s)
        return []
