"""The object dictionary of a simulated CiA 402 drive: what its EDS says, with values behind it.

Writing obeys type, length, range and access; PDO parameters obey CiA 301's order of remapping.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final

from hil.config import Actuator
from hil.drives.cia402.aborts import CODES, SdoAbort
from hil.drives.cia402.configure import DISABLED
from hil.drives.cia402.objects import Key, ObjectEntry
from hil.drives.cia402.profile import Cia402Profile

PARAMETERS: Final = (*range(0x1400, 0x1404), *range(0x1800, 0x1804))
MAPPINGS: Final = (*range(0x1600, 0x1604), *range(0x1A00, 0x1A04))
PDO_BITS: Final = 64


def abort(name: str) -> SdoAbort:
    """The abort of that name."""
    return SdoAbort(CODES[name])


class Objects:
    """Values by (index, subindex). `live` gives objects that are read from the drive itself."""

    def __init__(self, profile: Cia402Profile, actuator: Actuator, node: int) -> None:
        self._entries = profile.objects.entries
        self._profile, self._actuator, self._node = profile, actuator, node
        self.live: dict[Key, Callable[[], int]] = {}
        self.before_write: Callable[[Key, int], None] = lambda key, value: None
        self.refused: dict[Key, str] = {}
        """Objects that the drive refuses to have written, with the abort's name: to break it."""
        self.restart()

    def restart(self) -> None:
        """As after power-on: what was written is gone."""
        self._values: dict[Key, bytes] = {}
        self._numbers: dict[Key, int] = {}
        self._mapped: dict[int, tuple[ObjectEntry, ...]] = {}
        for key, entry in self._entries.items():
            value = entry.default
            if value is None:
                value = "" if entry.size is None else 0
            if entry.is_relative and isinstance(value, int):
                value += self._node
            self._set(key, entry.encode(value))
        rated_mnm = self._actuator.drive.force_per_count * 1000.0 * 1000.0
        self.put((0x6502, 0), self._profile.simulated.modes)
        self.put((0x6076, 0), min(round(rated_mnm), 2**32 - 1))

    def value(self, index: int, sub: int = 0) -> int:
        """An integer object's value; 0 where the EDS lacks it."""
        return self._numbers.get((index, sub), 0)

    def put(self, key: Key, value: int) -> None:
        """Set an object from inside; one that the EDS lacks stays away."""
        if key in self._entries:
            self._set(key, self._entries[key].encode(value))

    def read(self, index: int, sub: int) -> bytes:
        """The bytes that an SDO read gets."""
        entry = self._entry(index, sub)
        if not entry.readable:
            raise abort("write_only")
        if (index, sub) in self.live:
            return entry.encode(self.live[index, sub]())
        return self._values[index, sub]

    def write(self, index: int, sub: int, data: bytes) -> None:
        """What an SDO write does."""
        entry = self._entry(index, sub)
        if (index, sub) in self.refused:
            raise abort(self.refused[index, sub])
        if not entry.writable:
            raise abort("read_only")
        if entry.size is not None and len(data) != entry.size:
            raise abort("data_length")
        value = entry.decode(data)
        if isinstance(value, int):
            if value > (math.inf if entry.high is None else entry.high):
                raise abort("value_too_high")
            if value < (-math.inf if entry.low is None else entry.low):
                raise abort("value_too_low")
            self._check_pdo(index, sub, value)
            self.before_write((index, sub), value)
        self._set((index, sub), data)

    def mapped(self, mapping: int) -> tuple[ObjectEntry, ...]:
        """The objects that a PDO carries now."""
        found = self._mapped.get(mapping)
        if found is None:
            entries = (self.value(mapping, k) for k in range(1, self.value(mapping) + 1))
            found = tuple(self._entries[e >> 16, e >> 8 & 0xFF] for e in entries)
            self._mapped[mapping] = found
        return found

    def _set(self, key: Key, data: bytes) -> None:
        self._values[key] = data
        found = self._entries[key].decode(data)
        if isinstance(found, int):
            self._numbers[key] = found
        if key[0] in MAPPINGS:
            self._mapped.clear()

    def _entry(self, index: int, sub: int) -> ObjectEntry:
        if (index, sub) in self._entries:
            return self._entries[index, sub]
        is_there = any(i == index for i, _ in self._entries)
        raise abort("no_subindex" if is_there else "no_object")

    def _check_pdo(self, index: int, sub: int, value: int) -> None:
        if index in PARAMETERS and sub == 2 and self._is_enabled(index):
            raise abort("device_state")
        if index not in MAPPINGS:
            return
        if self._is_enabled(index - 0x200):
            raise abort("device_state")
        if sub == 0:
            bits = sum(self.value(index, k) & 0xFF for k in range(1, value + 1))
            if bits > PDO_BITS:
                raise abort("pdo_length")
            return
        if self.value(index) != 0:
            raise abort("device_state")
        entry = self._entries.get((value >> 16, value >> 8 & 0xFF))
        if value and (entry is None or entry.size is None or 8 * entry.size != value & 0xFF):
            raise abort("not_mappable")

    def _is_enabled(self, parameter: int) -> bool:
        return not self.value(parameter, 1) & DISABLED
