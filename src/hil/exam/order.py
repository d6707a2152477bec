"""What exam cases to make."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

from hil.errors import ConfigError
from hil.exam.rigs import ALL, RIDDEN, RIGS

KINDS: Final = ("none", "single", "double", "triple", "outside")
COUNTS: Final = {"none": 0, "double": 2, "triple": 3}
"""Effects of a case, where not one."""
MODES: Final = ("position", "force")
MOST_SCATTER: Final = 5.0
"""Noise is off by 15 % of its own, and must stay above 0."""


@dataclass(frozen=True, slots=True)
class Order:
    """What cases to make: everything that a case depends on, beside its number."""

    rigs: tuple[str, ...] = RIGS
    seed: int = 1000
    severities: tuple[float, ...] = (1.0, 3.0, 10.0)
    kinds: tuple[str, ...] = KINDS
    effects: tuple[str, ...] = ()
    """Only these effects (or outside effects); empty: all."""
    mode: str = "position"
    """What drives are told: positions, or forces by a loop outside them."""
    scatter: float = 1.0
    """By how many times the usual spread healthy rigs are off their files."""

    def __post_init__(self) -> None:
        for what, given, known in (
            ("rig", self.rigs, ALL),
            ("kind", self.kinds, KINDS),
            ("mode", (self.mode,), MODES),
        ):
            for name in given:
                if name not in known:
                    raise ConfigError(
                        f"{name!r} is no {what} of exam cases; choose of {', '.join(known)}"
                    )
        if self.mode == "force" and RIDDEN in self.rigs:
            raise ConfigError(f"a {RIDDEN} has no drives that could be told forces")
        if not 0.0 <= self.scatter <= MOST_SCATTER:
            raise ConfigError(f"scatter = {self.scatter:g} lies outside 0..{MOST_SCATTER:g}")
        if not self.rigs or not self.kinds or not all(s > 0.0 for s in self.severities):
            raise ConfigError("exam cases need a rig, a kind and severities above 0")

    @property
    def options(self) -> dict[str, Any]:
        """What a case depends on beside rig, seed and number, which are in its name."""
        return {
            "severities": list(self.severities),
            "kinds": list(self.kinds),
            "effects": sorted(self.effects),
            "mode": self.mode,
            "scatter": self.scatter,
        }

    def made_with(self, number: int) -> dict[str, Any]:
        """All that case `number` is made of, for its answer."""
        return {"seed": self.seed, "number": number, "options": self.options}

    def severity_of(self, reached: float) -> float:
        """The largest severity that an effect reaches: one that cannot be small stands higher."""
        return max((s for s in self.severities if s < 1.2 * reached), default=min(self.severities))

    def case_id(self, number: int) -> str:
        """Name of case `number`; it says nothing of what the case holds."""
        return f"{self.rigs[number % len(self.rigs)]}-{self.seed:04d}-{number:04d}"
