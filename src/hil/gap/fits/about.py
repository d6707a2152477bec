"""Starts about a start, for parameters whose cost is rugged: gaps, ticks, and swings that must be met.

An impact that comes early, a tick too late, a spring that swings at the wrong frequency: near the truth each
looks worse than none, so no slope leads there.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hil.sim.parameters import ParameterTable

Array = NDArray[np.float64]

TURNS: Final = 2
"""In which starts about one are tried: a spring's stiffness, then what else it has."""
RUGGED: Final = (".gap", ".delay", ".rate")
ABOUT: Final = (0.6, 0.75, 0.87, 1.15, 1.3, 1.5)
"""Times the start, from the parameter's neutral value."""
LIMIT: Final = ".limit"
CLOSER: Final = ((0.97, 0.0), (0.98, 0.0), (0.99, 0.0), (1.01, 0.0), (1.0, 0.15), (1.0, 0.4))
"""Times the start of a limit, and knees."""
SPRING: Final = ".compliance.stiffness"
STIFFER: Final = (0.4, 0.55, 0.75, 1.35, 1.8, 2.5)
LOOSER: Final = (0.4, 1.0, 2.5)
"""Times the damping ratio of the start."""
HARDER: Final = (0.6, 1.0, 1.6)
"""Times the stiffening of the start, where that has any; else none, or so much."""
HARD: Final = 0.25


def is_swinging(names: Iterable[str]) -> bool:
    """Whether a swing is among the parameters: its frequency and damping take long to settle."""
    return any(n.endswith(SPRING) for n in names)


def about(table: ParameterTable, start: Mapping[str, float], vector: Array, turn: int = 0) -> Array:
    """(B, P of `table`) vectors about `vector`, at which the parameters named in `start` were set.

    A spring's stiffness is tried first, its damping and stiffening in the next `turn`, about the best of the
    first; of others there is one turn.
    """
    spring = next((n for n in start if n.endswith(SPRING)), None)
    if spring is not None:
        k, d = table.index(spring), table.index(spring.replace("stiffness", "damping"))
        hard = table.index(spring.replace("stiffness", "hardening"))
        most = [h * vector[hard] for h in HARDER] if vector[hard] > 0.0 else [0.0, HARD]
        if turn == 0:
            some = np.array([(s, 1.0, vector[hard]) for s in STIFFER])
        else:
            some = np.array([(1.0, x, h) for x in LOOSER for h in most])
        rows = np.tile(vector, (len(some), 1))
        rows[:, k] = np.clip(vector[k] * some[:, 0], table[spring].lower, table[spring].upper)
        rows[:, d] = vector[d] * some[:, 1] * np.sqrt(some[:, 0])
        rows[:, hard] = some[:, 2]
        return rows
    if turn > 0:
        return np.empty((0, len(vector)))
    limit = next((n for n in start if n.endswith(LIMIT)), None)
    if limit is not None:
        i, knee = table.index(limit), table.index(limit.replace("limit", "knee"))
        both = np.array(CLOSER)
        rows = np.tile(vector, (len(both), 1))
        rows[:, i] = np.clip(vector[i] * both[:, 0], table[limit].lower, table[limit].upper)
        rows[:, knee] = both[:, 1]
        return rows
    name = next(iter(start), "")
    if len(start) != 1 or not name.endswith(RUGGED):
        return np.empty((0, len(vector)))
    i, p, times = table.index(name), table[name], np.array(ABOUT)
    rows = np.tile(vector, (len(times), 1))
    rows[:, i] = np.clip(p.neutral * (1.0 - times) + vector[i] * times, p.lower, p.upper)
    return rows
