"""An object dictionary as values: what an EDS says that a node has, and how it is read and written."""

from __future__ import annotations

import struct
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from difflib import get_close_matches
from typing import Final

from hil.drives.cia402.sdo import to_bytes
from hil.errors import ProtocolError

INTEGERS: Final[dict[int, tuple[int, bool]]] = {
    0x01: (1, False),
    0x02: (1, True),
    0x03: (2, True),
    0x04: (4, True),
    0x05: (1, False),
    0x06: (2, False),
    0x07: (4, False),
    0x15: (8, True),
    0x1B: (8, False),
}
"""Bytes and sign of CiA 301's integer data types, BOOLEAN among them."""
REAL32: Final = 0x08
VISIBLE_STRING: Final = 0x09

Key = tuple[int, int]


@dataclass(frozen=True, slots=True)
class ObjectEntry:
    """One object (index, subindex)."""

    index: int
    sub: int
    name: str
    data_type: int
    access: str = "rw"
    """ro, rw, wo, const, rwr or rww."""
    default: int | float | str | None = None
    low: int | None = None
    high: int | None = None
    is_relative: bool = False
    """Its default counts from the node's number ($NODEID)."""

    @property
    def readable(self) -> bool:
        """Whether it can be read."""
        return self.access != "wo"

    @property
    def writable(self) -> bool:
        """Whether it can be written."""
        return self.access in ("rw", "wo", "rww", "rwr")

    @property
    def size(self) -> int | None:
        """Bytes; None where they vary."""
        if self.data_type in INTEGERS:
            return INTEGERS[self.data_type][0]
        return 4 if self.data_type == REAL32 else None

    def encode(self, value: int | float | str | bytes) -> bytes:
        """A value as it travels; ProtocolError where the object cannot hold it."""
        if isinstance(value, bytes):
            return value
        if isinstance(value, str):
            return value.encode()
        if self.data_type in INTEGERS:
            size, signed = INTEGERS[self.data_type]
            bits = 8 * size - signed
            low = (-(1 << bits) if signed else 0) if self.low is None else self.low
            high = (1 << bits) - 1 if self.high is None else self.high
            if value != int(value) or not low <= value <= high:
                raise ProtocolError(f"{self}: {value} is no whole number within {low}..{high}")
            return to_bytes(int(value), size, signed=signed)
        if self.data_type == REAL32:
            return struct.pack("<f", value)
        raise ProtocolError(
            f"{self}: a number cannot be written to data type {self.data_type:#04x}"
        )

    def decode(self, data: bytes) -> int | float | str | bytes:
        """The value in `data`; ProtocolError where the length is another."""
        if self.size is not None and len(data) != self.size:
            raise ProtocolError(f"{self}: {len(data)} bytes came, it has {self.size}")
        if self.data_type in INTEGERS:
            return int.from_bytes(data, "little", signed=INTEGERS[self.data_type][1])
        if self.data_type == REAL32:
            return float(struct.unpack("<f", data)[0])
        if self.data_type == VISIBLE_STRING:
            return data.rstrip(b"\0").decode("latin-1")
        return data

    def parse(self, text: str) -> bytes:
        """What a person wrote, decimal, 0x... or text, as it travels; ProtocolError where it is none."""
        try:
            if self.data_type in INTEGERS:
                return self.encode(int(text, 0))
            if self.data_type == REAL32:
                return self.encode(float(text))
        except (ValueError, OverflowError):
            kind = "number" if self.data_type == REAL32 else "whole number"
            raise ProtocolError(f"{self}: {text!r} is no {kind}") from None
        return self.encode(text)

    def __str__(self) -> str:
        return f"{self.index:#06x}:{self.sub:02x} ({self.name})"


@dataclass(frozen=True)
class ObjectDictionary:
    """All objects of an EDS, and whose device it describes."""

    entries: Mapping[Key, ObjectEntry]
    vendor: int | None = None
    product: int | None = None
    revision: int | None = None
    source: str = ""
    """The file."""
    _names: dict[str, Key] = field(default_factory=dict, init=False, repr=False)

    def __post_init__(self) -> None:
        for key, entry in self.entries.items():
            self._names.setdefault(_plain(entry.name), key)

    def __contains__(self, key: Key) -> bool:
        return key in self.entries

    def __getitem__(self, key: Key) -> ObjectEntry:
        return self.entries[key]

    def __iter__(self) -> Iterator[ObjectEntry]:
        return iter(self.entries.values())

    def find(self, name: str) -> ObjectEntry:
        """The object that a person names: 0x6065, 0x1018:2, or its name in the EDS; ProtocolError if none."""
        try:
            index, _, sub = name.partition(":")
            key = (int(index, 16), int(sub or "0", 16))
        except ValueError:
            key = self._names.get(_plain(name), (-1, 0))
        if key in self.entries:
            return self.entries[key]
        plain = _plain(name)
        alike = [*(n for n in self._names if plain in n), *get_close_matches(plain, self._names)]
        near = [self.entries[self._names[n]].name for n in dict.fromkeys(alike)][:4]
        hint = f"; near: {', '.join(near)}" if near else ""
        raise ProtocolError(f"{self.source or 'the EDS'} has no object {name!r}{hint}")


def _plain(name: str) -> str:
    return "".join(c for c in name.lower() if c.isalnum())
