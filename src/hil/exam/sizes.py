"""How near the named parameters come to the true ones, and whether their intervals hold them.

Errors are relative to how far the true value stands from neutral, vectors (x y z) as a whole; a value that is
not given counts as neutral, an error of 1. A phase counts only in its interval, whole turns apart alike: it
means nothing without the period.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

from hil.exam.paper import Paper

ONE: Final = ("scale", "position", "speed", "integral")
"""Parameters that are neutral at 1."""
VECTORS: Final = (("x", "y", "z"), ("xx", "yy", "zz"), ("roll", "pitch"))
MAIN: Final = {
    "force_ripple": ("amplitude",),
    "stribeck_friction": ("coulomb", "static"),
    "hysteresis": ("force",),
    "compliance": ("stiffness",),
    "load_friction": ("coefficient",),
    "lead_error": ("scale", "amplitude"),
}
"""Where an effect has parameters besides the one that says how large it is."""


@dataclass(frozen=True, slots=True)
class Size:
    """One parameter, or one vector."""

    name: str
    error: float | None
    """Relative; None where the truth is neutral."""
    covered: tuple[bool, ...]
    """One for each interval given."""
    is_main: bool


def sizes(paper: Paper) -> list[Size]:
    """Every parameter of the first cause, where it is a true effect at its place."""
    first = paper.cause(0)
    if first is None or first not in paper.truth:
        return []
    effect = paper.answer["effects"][paper.truth.index(first)]
    truth = {k: float(v) for k, v in (effect.get("parameters") or {}).items()}
    said = paper.causes[0].get("parameters") or {}
    out: list[Size] = []
    done: set[str] = set()
    for group in VECTORS:
        inside = [k for k in group if k in truth]
        if len(inside) > 1:
            out.append(_vector(effect["effect"], inside, truth, said))
            done |= set(inside)
    main = MAIN.get(effect["effect"])
    for k, value in truth.items():
        if k not in done:
            out.append(_single(k, value, said.get(k), main is None or k in main))
    return out


def _single(name: str, true: float, said: Any, is_main: bool) -> Size:
    value = _value(said)
    covered = _covers(said, _turned(true, value) if name == "phase" else true)
    away = abs(true - 1.0) if name in ONE else abs(true)
    if name == "phase" or away < 1e-12:
        return Size(name, None, covered, is_main)
    if value is None:
        return Size(name, 1.0, covered, is_main)
    return Size(name, abs(value - true) / away, covered, is_main)


def _vector(
    effect: str, names: list[str], truth: Mapping[str, float], said: Mapping[str, Any]
) -> Size:
    values = [_value(said.get(k)) or 0.0 for k in names]
    length = math.dist([truth[k] for k in names], [0.0] * len(names))
    error = math.dist(values, [truth[k] for k in names]) / max(length, 1e-12)
    held = [c for k in names for c in _covers(said.get(k), truth[k])]
    return Size(effect, error, tuple(held), True)


def _turned(phase_rad: float, near_rad: float | None) -> float:
    """The same phase, by whole turns as near to another as it comes."""
    if near_rad is None:
        return phase_rad
    return phase_rad + math.tau * round((near_rad - phase_rad) / math.tau)


def _value(said: Any) -> float | None:
    if isinstance(said, Mapping):
        said = said.get("value")
    return float(said) if isinstance(said, int | float) else None


def _covers(said: Any, true: float) -> tuple[bool, ...]:
    """Whether the interval holds the truth; nothing where none was given."""
    ci = said.get("ci") if isinstance(said, Mapping) else None
    if not isinstance(ci, list | tuple) or len(ci) != 2:
        return ()
    low = -math.inf if ci[0] is None else float(ci[0])
    high = math.inf if ci[1] is None else float(ci[1])
    return (low <= true <= high,)
