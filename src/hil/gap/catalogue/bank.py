"""What each candidate does to every sample: the columns of all starts of all leaves, computed in one go.

A column is the change of the twin's answer when its parameters take their finite values: a finite step,
because gaps and limits do nothing in the small. On rigs of many actuators one replay serves the same column
of all of them, each judged by its own actuator's signals: what one leg's friction does to another leg is
left to the fits that follow. Not so what puts the platform elsewhere: all signals show it. Columns of
sensors need no replay of their own. Those of another twin of the same record stand for this one's: columns
say what is worth a fit, and fits have the twin itself.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import chain
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hil.gap.catalogue.nature import PLACING
from hil.gap.record.leaf import Changes, Leaf
from hil.gap.record.problem import Problem

Array = NDArray[np.float64]
Columns = NDArray[np.float32]

TOGETHER_FROM: Final = 3
"""Actuators from which on one replay serves a column of all of them."""
AT_ONCE: Final = 16


@dataclass(frozen=True, slots=True)
class Bank:
    """Columns (N, M) of all leaves' starts."""

    leaves: tuple[Leaf, ...]
    columns: Columns
    places: tuple[tuple[tuple[int, ...], ...], ...]
    """Of each leaf, for each start, the indices of its columns."""


@dataclass(frozen=True, slots=True)
class _Wanted:
    column: int
    changes: Changes
    actuator: str | None
    key: tuple[str, int]


def fill_bank(
    problem: Problem,
    vector: Array,
    base: Array,
    leaves: Sequence[Leaf],
    known: Bank | None = None,
) -> Bank:
    """The bank at `vector`, at which the twin answers `base` (N,).

    `known`: one of another twin and the same samples, whose columns are taken for leaves that have not
    changed, but for those of effects that this twin has.
    """
    wanted: list[_Wanted] = []
    places = []
    for leaf in leaves:
        by_start, k = [], 0
        for start in leaf.starts:
            cols = []
            for column in start.columns:
                cols.append(len(wanted))
                changes = {**start.fixed, **column}
                wanted.append(_Wanted(len(wanted), changes, leaf.actuator, (leaf.effect, k)))
                k += 1
            by_start.append(tuple(cols))
        places.append(tuple(by_start))
    out = np.zeros((problem.size, len(wanted)), dtype=np.float32)
    has = {e.effect for e in problem.rig.effects}
    old = _columns_of(known, [x for x in leaves if x.effect not in has], problem.size)
    done = set()
    for leaf, starts in zip(leaves, places, strict=True):
        if leaf.name in old:
            mine = list(chain(*starts))
            out[:, mine] = old[leaf.name]
            done.update(mine)
    replayed = [
        w for w in wanted if w.column not in done and not _sensor_column(problem, w, base, out)
    ]
    groups: dict[object, list[_Wanted]] = {}
    together = len(problem.rig.actuators) >= TOGETHER_FROM
    for w in replayed:
        own = _own_signal(problem, w)
        shared = together and w.actuator is not None and w.key[0] not in PLACING
        groups.setdefault(w.key if shared or own is not None else w.column, []).append(w)
    apart = list(groups.values())
    for first in range(0, len(apart), AT_ONCE):
        some = apart[first : first + AT_ONCE]
        rows = np.array([_changed(problem, vector, g) for g in some])
        for group, moved in zip(some, problem.changes(rows, vector, base), strict=True):
            change = np.where(np.isfinite(moved), moved, 0.0)
            for w in group:
                if len(group) == 1:
                    out[:, w.column] = change
                    continue
                own = _own_signal(problem, w)
                for x in problem.series:
                    if x.signal == own or (own is None and x.actuator == w.actuator):
                        out[x.part, w.column] = change[x.part]
    return Bank(tuple(leaves), out, tuple(places))


def _columns_of(known: Bank | None, leaves: Sequence[Leaf], size: int) -> dict[str, Columns]:
    """Columns (N, K) of those of `leaves` that are in the bank `known` as they are, by name."""
    if known is None or len(known.columns) != size:
        return {}
    now = {x.name: x for x in leaves}
    return {
        x.name: known.columns[:, list(chain(*by_start))]
        for x, by_start in zip(known.leaves, known.places, strict=True)
        if now.get(x.name) == x
    }


def _changed(problem: Problem, vector: Array, group: Sequence[_Wanted]) -> Array:
    """`vector` with all changes of a group; those of linear parameters are added, others set."""
    row = np.array(vector)
    for w in group:
        for name, value in w.changes.items():
            i = problem.table.index(name)
            row[i] = shifted(problem, name, float(vector[i]), value)
    return row


def shifted(problem: Problem, name: str, now: float, value: float) -> float:
    """`value`, given as for a twin without effects, for one whose parameter is `now`; within bounds."""
    p = problem.table[name]
    if p.search == "linear" and np.isfinite(p.neutral) and p.parameter not in ABSOLUTE:
        value = now + (value - p.neutral)
    return min(max(value, p.lower), p.upper)


ABSOLUTE: Final = ("limit", "velocity", "displacement", "period", "phase", "gap", "asymmetry")
"""Parameters of which only the value itself means something, not its distance from neutral."""


def _sensor_column(problem: Problem, w: _Wanted, base: Array, out: Columns) -> bool:
    """Fill the column of a bias or scale of one signal or of the IMU; False for all others."""
    if len(w.changes) != 1:
        return False
    ((name, value),) = w.changes.items()
    place, _, parameter = name.rpartition(".")
    signal, _, effect = place.rpartition(".")
    if effect not in ("sensor_bias", "sensor_scale"):
        return False
    if signal != "imu" and signal not in problem.signals:  # a sensor whose answers drive the twin
        return False
    if problem.leads(signal):
        return False
    for x in problem.series:
        if x.signal != signal and not (signal == "imu" and x.actuator == "imu"):
            continue
        now = base[x.part]
        if parameter == "offset":
            out[x.part, w.column] = value
        else:
            out[x.part, w.column] = (value - 1.0) * (now - _centre(problem, x.signal))
    return True


def _own_signal(problem: Problem, w: _Wanted) -> str | None:
    """The signal that a column changes alone, where it is the latency of one."""
    name = next(iter(w.changes))
    signal = name.removesuffix(".sensor_latency.delay")
    is_own = signal != name and signal in problem.signals and not problem.leads(signal)
    return signal if is_own else None


def _centre(problem: Problem, signal: str) -> float:
    place, _, quantity = signal.rpartition(".")
    if quantity != "position":
        return 0.0
    return next(a.home for a in problem.rig.actuators if a.name == place)
