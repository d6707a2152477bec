"""How a unit stands behind a number; "1" is that of a number without dimension."""

from __future__ import annotations


def with_unit(number: str, unit: str) -> str:
    """A number, already in words, and its unit, which what has no dimension has not."""
    return number if unit in ("", "1") else f"{number} {unit}"
