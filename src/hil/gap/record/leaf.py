"""A candidate: one effect at one place, and where its fit may start."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

Changes = Mapping[str, float]


@dataclass(frozen=True, slots=True)
class Start:
    """Values that are set, and the columns: parameters moved together by an amplitude of 1."""

    fixed: Changes
    columns: tuple[Changes, ...]


@dataclass(frozen=True, slots=True)
class Leaf:
    """One effect at one place: full names of its parameters, and where a fit of it may start."""

    effect: str
    location: str
    parameters: tuple[str, ...]
    starts: tuple[Start, ...]
    actuator: str | None
    """The actuator it sits at, None for what the whole rig shares."""
    places: int = 1
    """Where its effect could sit on these data."""

    @property
    def name(self) -> str:
        """`location.effect`."""
        return f"{self.location}.{self.effect}"
