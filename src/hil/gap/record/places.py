"""Where a drive's ticks lie: places that make its force clearer than any delay does.

Two things tell. Frames that come near a tick act now at one and now at the next, which kicks the drive; and a
force that is read within a tick of a setpoint has seen the loop's answer or has not, most of all where the
drive rests at setpoints. For the second it matters as much how late the drive answers, so that is looked for
along with the place; what frames make of the place alone, calibration makes of the rest.
"""

from __future__ import annotations

import os
from collections import defaultdict
from collections.abc import Callable, Collection, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hil.gap.record.fineness import CLEARER, fine_structure, fineness
from hil.gap.record.problem import FORCES, Problem
from hil.gap.record.ticks import Key, Ticks, acting
from hil.identify.replay import Stretch

Array = NDArray[np.float64]

PLACES: Final = 32
"""Places of the ticks that are replayed."""
ALONE: Final = 16
"""The same of each of several drives that are moved apart, where they do not rest at setpoints."""
FEW: Final = 3
"""Drives up to which each is moved alone as well: of six, ticks so found had made a healthy rig late [R]."""
AMONG: Final = (0.01, 0.04, 0.1, 0.2, 0.35, 0.5, 0.65, 0.8, 0.9, 0.96, 0.99)
"""Shares of the frames that come before a tick, of further places where frames jitter by no more than two of
those: between two of them all frames would change their tick."""
LATE: Final = (-0.3, -0.2, -0.1, 0.0, 0.1, 0.2, 0.3)
"""Ticks by which forces may be answered later than the rig file says: how much of a tick an answer has seen
depends on it as much as on the place."""
SHIFTS: Final = (-0.5, -0.25, 0.0, 0.25, 0.5, 0.75, 1.0, 1.25, 1.5)
"""Ticks by which setpoints may act later than on average, without ticks: what a delay does tells of none."""
WINDOW_S: Final = 2.0
FASTEST: Final = 2e-4
"""s/s that a drive's clock may run off the bus's [M: crystals 50 ppm each, resonators more]."""
RATE_STEP: Final = 2e-6
USUAL: Final = 5e-5
"""Standard deviation of that: where frames never come near a tick, little tells of a drift."""
ENOUGH: Final = 12
"""Steps of a force from which on a window tells anything."""
FEWEST: Final = 3
"""Windows from which on a record does."""


def find_places(problem: Problem, vector: Array) -> tuple[dict[Key, Ticks], Array]:
    """The drives of which some place of the ticks makes their force clearer than any delay does, and than no
    ticks with the same delay on average, and that place; `vector` (P,) with answers as late as they then
    seem.

    Kicks of one drive go through the platform into the forces of the others. Moved at once, the ticks of all
    lie where the strongest drive has its own, which is right where drives share a clock; moved one by one
    they are less sharp. Of both ways the one counts beside which force is clearer. Of more than FEW drives
    none stands out from the kicks of the others: those are moved at once.
    """
    at_once = places_of(problem, vector, together=True)
    if not 1 < len(problem.rig.actuators) <= FEW:
        return at_once
    return min(at_once, _one_by_one(problem, vector), key=lambda way: _left(problem, *way))


def _left(problem: Problem, found: Mapping[Key, Ticks], vector: Array) -> float:
    """Log of the fine structure of all forces beside the ticks `found`."""
    flat = problem.with_clocks(found).predict(vector)[0]
    driven = [k for k, piece in enumerate(problem.pieces) if piece.mode == "position"]
    return sum(fineness(problem, k, a, flat) for k in driven for a in problem.rig.actuator_names)


def _one_by_one(problem: Problem, vector: Array) -> tuple[dict[Key, Ticks], Array]:
    """`find_places` of each drive beside others that have no ticks, and of those whose kicks are hidden by
    others' once more beside these."""
    found: dict[Key, Ticks] = {}
    while True:
        more, vector = places_of(problem.with_clocks(found), vector)
        found |= more
        if not more or len(found) == len(problem.pieces) * len(problem.rig.actuators):
            return found, vector


def places_of(
    problem: Problem, vector: Array, *, together: bool = False
) -> tuple[dict[Key, Ticks], Array]:
    """`find_places` of the drives of which `problem` knows no clock, each alone or all `together`."""
    rig = problem.rig
    tick, late_s = rig.bus.position_loop, [k * rig.bus.position_loop for k in LATE]
    own = [problem.table.index(f"{a}.transport_delay.delay") for a in rig.actuator_names]
    driven = [k for k, piece in enumerate(problem.pieces) if piece.mode == "position"]

    def delayed(by: float) -> Array:
        row = np.array(vector)
        row[own] += by * tick
        return problem.forces_late(row, late_s)

    def placed(at_s: Mapping[Key, float]) -> Array:
        ticks = {key: Ticks(phase_s, 0.0, 0.0) for key, phase_s in at_s.items()}
        return problem.with_clocks({**problem.clocks, **ticks}).forces_late(vector, late_s)

    def sizes(asked: tuple[Callable[[], Array], Collection[Key]]) -> dict[Key, Array]:
        answers = asked[0]()
        return {key: seen[key].sizes(problem, key, answers) for key in asked[1]}

    usual = delayed(0.0)
    new = [(k, a) for k in driven for a in rig.actuator_names if (k, a) not in problem.clocks]
    seen = {key: _Seen.of(problem, key, usual) for key in new}
    seen = {key: x for key, x in seen.items() if len(x.t) >= FEWEST}
    if not seen:
        return {}, vector
    apart = [[key for key in seen if key[1] == a] for a in sorted({a for _, a in seen})]
    at_once = [list(seen)] if together else apart
    is_quick = len(at_once) > 1 and rig.bus.interpolation != "linear_rests"
    spread = np.arange(0.0, 1.0, 1.0 / (ALONE if is_quick else PLACES)) * tick
    among = {key: _among(problem, key) for key in seen}
    asked = [(partial(delayed, by), list(seen)) for by in SHIFTS]
    for keys in at_once:
        tried = [dict.fromkeys(keys, float(phase_s)) for phase_s in spread]
        close = [key for key in keys if len(among[key])]
        tried += [{key: float(among[key][m]) for key in close} for m in range(len(AMONG)) if close]
        asked += [(partial(placed, at_s), list(at_s)) for at_s in tried]
    rows: dict[Key, list[Array]] = {key: [] for key in seen}
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        for sizes_there in pool.map(sizes, asked):
            for key, size in sizes_there.items():
                rows[key].append(size)
    best = {key: _best(x, np.array(rows[key]), tick, spread, among[key]) for key, x in seen.items()}
    clearest = {key: b for key, b in best.items() if b is not None}
    if not clearest:
        return {}, np.array(vector)
    even = _evenly(problem, {key: b.ticks for key, b in clearest.items()})
    evenly = even.forces_late(vector, late_s, in_step=True)
    found, answers_s = {}, defaultdict(list)
    for key, b in clearest.items():
        without = seen[key].sizes(problem, key, evenly)[b.late]
        if float(np.mean(without)) - b.size >= CLEARER:
            found[key] = b.ticks
            answers_s[key[1]].append(late_s[b.late])
    answered = np.array(vector)
    for a, told in answers_s.items():
        for q in FORCES:
            i = problem.table.index(f"{a}.{q}.sensor_latency.delay")
            answered[i] += float(np.median(told))
    return found, answered


def _evenly(problem: Problem, found: Mapping[Key, Ticks]) -> Problem:
    """The same problem without ticks, setpoints of those `found` as late as they are there on average, or
    evenly later and later: what lags more and more is no clock that drifts."""

    def shifted(k: int, piece: Stretch) -> Stretch:
        told = dict(piece.setpoints)
        for a, (t, v) in piece.setpoints.items():
            if (k, a) in found and len(t) > 1:
                waits = acting(problem.rig, t, found[k, a]) - t
                told[a] = t + np.polyval(np.polyfit(t, waits, 1), t), v
        return replace(piece, setpoints=told)

    return problem.on([shifted(k, p) for k, p in enumerate(problem.sent)], problem.clocks)


@dataclass(frozen=True, slots=True)
class _Best:
    """Of one drive: where its ticks seem to lie, which of LATE its answers are, and what is left then."""

    ticks: Ticks
    late: int
    size: float


@dataclass(frozen=True, slots=True)
class _Seen:
    """Where one drive's force is looked at: W windows about `t` (W,)."""

    t: Array
    inside: tuple[tuple[int, NDArray[np.bool_]], ...]
    """Of each window: which of the drive's signals, and which of its steps (M - 1,)."""
    most: tuple[Array, ...]
    """Of each signal (LATE,): steps that are larger count no more than that."""

    @staticmethod
    def of(problem: Problem, key: Key, usual: Array) -> _Seen:
        """Of the drive `key`, whose force counts beside the answers `usual` (LATE, N)."""
        centres, windows, most = [], [], []
        for k, (stamps, steps, kept) in enumerate(fine_structure(problem, *key, list(usual))):
            most.append(6.0 * np.median(steps, axis=1) + 1e-12)
            for start in np.arange(stamps[0], stamps[-1], WINDOW_S):
                inside = ((stamps >= start) & (stamps < start + WINDOW_S))[1:] & kept
                if inside.sum() >= ENOUGH:
                    windows.append((k, inside))
                    centres.append(float(start) + 0.5 * WINDOW_S)
        return _Seen(np.array(centres), tuple(windows), tuple(most))

    @property
    def count(self) -> int:
        """Steps that are looked at."""
        return sum(int(inside.sum()) for _, inside in self.inside)

    def sizes(self, problem: Problem, key: Key, answers: Array) -> Array:
        """(LATE, W) log of the fine structure of the drive `key` beside `answers` (LATE, N)."""
        every = [
            np.minimum(steps, most[:, None]) ** 2
            for (_, steps, _), most in zip(
                fine_structure(problem, *key, list(answers)), self.most, strict=True
            )
        ]
        powers = [np.mean(every[k][:, inside], axis=1) for k, inside in self.inside]
        return np.asarray(0.5 * np.log(np.stack(powers, axis=1) + 1e-300))


def _among(problem: Problem, key: Key) -> Array:
    """(AMONG,) places of ticks among frames that come at almost the same place of them; (0,) where frames of
    a drive spread further."""
    tick = problem.rig.bus.position_loop
    there = problem.sent[key[0]].setpoints[key[1]][0] + problem.rig.bus.setpoint_delay
    about = tick * float(np.angle(np.mean(np.exp(2j * np.pi * there / tick)))) / (2.0 * np.pi)
    off = (there - about + 0.5 * tick) % tick - 0.5 * tick
    if float(np.std(off)) > 2.0 * tick / PLACES:
        return np.empty(0)
    return np.asarray(about + np.quantile(off, AMONG))


def _best(seen: _Seen, table: Array, tick_s: float, spread: Array, among: Array) -> _Best | None:
    """`table` (SHIFTS + S + AMONG, LATE, W): sizes without ticks, with them at places `spread` (S,) over
    a tick, s, and at those `among` the frames; None where any delay does as well as the best of these."""
    origin, count = float(seen.t[0]), len(spread)
    without, at_places, at_among = np.split(table, [len(SHIFTS), len(SHIFTS) + count])
    best = _Best(Ticks(0.0, 0.0, origin), 0, np.inf)
    columns, places = np.arange(len(seen.t)), np.arange(count)[:, None]
    for rate in np.arange(-FASTEST, FASTEST + 1e-12, RATE_STEP):
        shift = rate * (seen.t - origin) / tick_s
        unlikely = 0.5 * (rate / USUAL) ** 2 / seen.count
        k = np.round(places + shift * count).astype(np.int64) % count
        totals = np.mean(at_places[k, :, columns], axis=1) + unlikely
        p, late = map(int, np.unravel_index(int(np.argmin(totals)), totals.shape))
        if totals[p, late] < best.size:
            ticks = Ticks(float(spread[p]), float(rate), origin)
            best = _Best(ticks, late, float(totals[p, late]))
    for phase_s, sizes in zip(among, np.mean(at_among, axis=2), strict=False):
        late = int(np.argmin(sizes))
        if sizes[late] < best.size:
            best = _Best(Ticks(float(phase_s), 0.0, origin), late, float(sizes[late]))
    return best if best.size <= float(np.mean(without, axis=2).min()) - CLEARER else None
