"""When setpoints really act: the ticks of each drive's own clock, read from the fine structure of a record.

A drive takes a setpoint at the first tick of its position loop after the frame's arrival. Send times jitter,
so the same frame may act up to a tick later than another, and a moving drive answers that with a kick of
force many times the sensor's noise. Where the ticks lie, and how fast they wander against the bus, stands in
no rig file. But at the right place of the ticks the twin's kicks fall on the drive's, and cancel: that
place is looked for in windows along the record, as a straight line in time for each drive. Where no place
does it (drives without ticks, stamps of another clock) setpoints act half a tick after their arrival, as
they do on average, and the kicks count as noise.

Drives on a bus with SYNC, which may have ticks of their own all the same: `hil.gap.record.synced`; drives
that play setpoints by a clock that the first frame starts: `hil.gap.record.started`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from statistics import fmean
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hil.gap.record.apart import apart
from hil.gap.record.fineness import CLEARER, fine_structure, fineness
from hil.gap.record.latecomers import SURE, Synced
from hil.gap.record.places import find_places, places_of
from hil.gap.record.problem import FORCES, Problem
from hil.gap.record.started import started
from hil.gap.record.synced import at_sync
from hil.gap.record.ticks import AtSync, Clocks, Key, Ticks
from hil.identify.jumps import fewest_jumps

Array = NDArray[np.float64]

DELAYS_S: Final = (0.0, 0.001, 0.002, 0.003, 0.004, 0.006, 0.008, 0.012, 0.016)
TURNS: Final = (
    ("phase_s", 0.03, 2), ("rate", 3e-6, 2), ("phase_s", 0.015, 2), ("rate", 1e-6, 2),
    ("late_s", 0.15, 3), ("late_s", 0.025, 2), ("late_s", 0.01, 2), ("phase_s", 0.015, 2), ("rate", 1e-6, 2),
    ("late_s", 0.01, 2), ("phase_s", 0.005, 2), ("late_s", 0.004, 2),
)  # fmt: skip
"""What is moved in turn once ticks are found, by steps of so many ticks (rate: s/s), so many either way: a
frame that comes near a tick acts at this one or the next, and only a few hundredths of a tick tell which.
First their places: late frames look much like late ticks."""
TURNS_FAST: Final = (
    ("phase_s", 0.01, 3),
    ("rate", 1e-6, 2),
    ("phase_s", 0.003, 3),
    ("rate", 3e-7, 2),
)
"""The same on a fast bus, whose frames jitter by little: hundredths of a tick tell which act at the next."""


def find_clocks(problem: Problem, vector: Array | None = None) -> Clocks:
    """The ticks of every drive in every stretch where they can be told; empty where they cannot.

    `vector` (P,): the twin that they are looked for beside, where one is known that explains the record; by
    default the rig file's, as late as each drive seems.
    """
    bus, beside = problem.rig.bus, problem.base if vector is None else vector
    if bus.retimed:
        return started(problem, beside)
    if bus.schedule == "fast":
        synced = at_sync(problem, beside)
        found: dict[Key, Ticks | AtSync] = dict(synced)
        if bus.interpolation != "hold":
            own = _as_clear(problem, places_of(problem, beside, together=True)[0], synced, beside)
            found |= _refined(problem, own, beside, TURNS_FAST)
        return apart(problem, found, beside, bus.position_loop, fmean)
    if bus.position_loop <= bus.speed_loop or bus.interpolation == "hold":
        return {}
    ticks, answered = find_places(problem, beside)
    if vector is None:
        delayed = _delayed(problem, ticks, answered)
        if not np.array_equal(delayed, problem.base):
            ticks, answered = find_places(problem, delayed)
    return _refined(problem, ticks, answered, TURNS)


def _as_clear(
    problem: Problem, found: Mapping[Key, Ticks], synced: Synced, vector: Array
) -> dict[Key, Ticks]:
    """Those of `found` beside which force is clearer than where setpoints act at SYNC, the late frames told
    there set off: drives that take setpoints as they come, of which stamps tell what is late."""
    if not found:
        return {}
    own, regular = (problem.with_clocks(c).predict(vector)[0] for c in (found, synced))

    def told(key: Key) -> float:
        samples = sum(
            int(problem.kept[x.part].sum())
            for x in problem.series
            if x.quantity in FORCES and (x.stretch, x.actuator) == key
        )
        late = synced[key].late if key in synced else ()
        return SURE * len(late) / max(samples, 1)

    return {
        key: ticks
        for key, ticks in found.items()
        if fineness(problem, *key, own) < fineness(problem, *key, regular) - CLEARER + told(key)
    }


def _delayed(problem: Problem, found: Mapping[Key, Ticks], answered: Array) -> Array:
    """The rig file's vector with the delay at which each drive's force is nearest to the record's, where that
    is nearer than beside the ticks `found` and answers as of `answered`: ticks are looked for there, so that
    a late drive has them too."""
    out, names = np.array(problem.base), problem.rig.actuator_names

    def sizes(told: Problem, row: Array) -> list[float]:
        flat = told.predict(row)[0]
        return [
            sum(fineness(problem, k, a, flat) for k in range(len(problem.pieces))) for a in names
        ]

    late = []
    for delay in DELAYS_S:
        row = np.array(problem.base)
        for a in names:
            row[problem.table.index(f"{a}.transport_delay.delay")] += delay
        late.append(sizes(problem, row))
    beside = sizes(problem.with_clocks(found), answered)
    for j, a in enumerate(names):
        mine = np.array([row[j] for row in late])
        best = int(np.argmin(mine))
        if mine[best] < min(mine[0], beside[j]) - CLEARER * len(problem.pieces):
            out[problem.table.index(f"{a}.transport_delay.delay")] += DELAYS_S[best]
    return out


def _refined(
    problem: Problem,
    found: dict[Key, Ticks],
    vector: Array,
    turns: Sequence[tuple[str, float, int]],
) -> dict[Key, Ticks]:
    """The same ticks, placed so that frames which come near one act where the record says they did; `turns`:
    what is moved in turn, as TURNS says."""
    if not found:
        return found

    def steps_of(clocks: Mapping[Key, Ticks]) -> dict[Key, Array]:
        flat = problem.with_clocks(clocks).predict(vector)[0]
        return {
            key: np.concatenate(
                [s[0, kept] for _, s, kept in fine_structure(problem, *key, [flat])]
            )
            for key in clocks
        }

    moves = [(most, _moving(problem, name, step)) for name, step, most in turns]
    return fewest_jumps(found, moves, steps_of)[0]


def _moving(problem: Problem, name: str, step: float) -> Callable[[Key, Ticks, int], Ticks]:
    """What moves one number of ticks by so many `step`s; the rate about the middle of the stretch."""

    def moved(key: Key, ticks: Ticks, count: int) -> Ticks:
        by = count * step
        if name != "rate":
            late = {name: getattr(ticks, name) + by * problem.rig.bus.position_loop}
            return replace(ticks, **late)
        start, end = problem.pieces[key[0]].span_s
        turn = by * (0.5 * (start + end) - ticks.origin_s)
        return replace(ticks, rate=ticks.rate + by, phase_s=ticks.phase_s - turn)

    return moved
