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
from hil.gap.record.problem import Problem
from hil.gap.record.started import started
from hil.gap.record.synced import at_sync
from hil.gap.record.ticks import AtSync, Clocks, Ticks
from hil.identify.jumps import fewest_jumps

Array = NDArray[np.float64]

PLACES: Final = 8
"""Places of the ticks that are replayed."""
FINE: Final = 32
WINDOW_S: Final = 2.0
FASTEST: Final = 2e-4
"""s/s that a drive's clock may run off the bus's [M: crystals 50 ppm each, resonators more]."""
RATE_STEP: Final = 2e-6
USUAL: Final = 5e-5
"""Standard deviation of that: where frames never come near a tick, little tells of a drift."""
ENOUGH: Final = 12
DELAYS_S: Final = (0.0, 0.001, 0.002, 0.003, 0.004, 0.006, 0.008, 0.012, 0.016)
TURNS: Final = (
    ("phase_s", 0.03, 2), ("rate", 3e-6, 2), ("phase_s", 0.015, 2), ("rate", 1e-6, 2),
    ("late_s", 0.15, 3), ("late_s", 0.025, 2), ("late_s", 0.01, 2), ("phase_s", 0.015, 2), ("rate", 1e-6, 2),
    ("late_s", 0.01, 2), ("phase_s", 0.005, 2), ("late_s", 0.004, 2),
)  # fmt: skip
"""What is moved in turn once ticks are found, by steps of so many ticks (rate: s/s), so many either way: a
frame that comes near a tick acts at this one or the next, and only a few hundredths of a tick tell which.
First their places: late frames look much like late ticks."""


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
        found: dict[tuple[int, str], Ticks | AtSync] = dict(synced)
        if bus.interpolation != "hold":
            found |= _as_clear(problem, _at_ticks(problem, beside), synced, beside)
        return apart(problem, found, beside, bus.position_loop, fmean)
    if bus.position_loop <= bus.speed_loop or bus.interpolation == "hold":
        return {}
    vector = _delayed(problem) if vector is None else vector
    return _refined(problem, _at_ticks(problem, vector), vector)


def _at_ticks(problem: Problem, vector: Array) -> dict[tuple[int, str], Ticks]:
    """The drives of which some place of the ticks makes their force clearer, and that place."""
    tick = problem.rig.bus.position_loop
    pieces = problem.pieces
    names = problem.rig.actuator_names
    flats = [problem.predict(vector)[0]]
    for p in range(PLACES):
        ticks = Ticks(p * tick / PLACES, 0.0, 0.0)
        clocks = {(k, a): ticks for k in range(len(pieces)) for a in names}
        flats.append(problem.with_clocks(clocks).predict(vector)[0])
    found = {}
    for k in range(len(pieces)):
        if pieces[k].mode != "position":
            continue
        for a in names:
            best = _best(problem, k, a, flats, tick)
            if best is not None:
                found[k, a] = best
    return found


def _as_clear(
    problem: Problem, found: Mapping[tuple[int, str], Ticks], synced: Synced, vector: Array
) -> dict[tuple[int, str], Ticks]:
    """Those of `found` beside which force is as clear as where setpoints act at SYNC, the late frames told
    there set off: drives that take setpoints as they come, of which stamps tell what is late."""
    if not found:
        return {}
    own, regular = (problem.with_clocks(c).predict(vector)[0] for c in (found, synced))

    def told(key: tuple[int, str]) -> float:
        samples = sum(
            int(problem.kept[x.part].sum())
            for x in problem.series
            if x.quantity in ("force", "current") and (x.stretch, x.actuator) == key
        )
        late = synced[key].late if key in synced else ()
        return SURE * len(late) / max(samples, 1)

    return {
        key: ticks
        for key, ticks in found.items()
        if fineness(problem, *key, own) < fineness(problem, *key, regular) + CLEARER + told(key)
    }


def _delayed(problem: Problem) -> Array:
    """The rig file's vector with the delay at which each drive's force is nearest to the record's: ticks are
    looked for there, so that a late drive has its ticks found too."""
    out = np.array(problem.base)
    sizes = []
    for delay in DELAYS_S:
        row = np.array(problem.base)
        for a in problem.rig.actuator_names:
            row[problem.table.index(f"{a}.transport_delay.delay")] += delay
        flat = problem.predict(row)[0]
        sizes.append(
            [
                sum(fineness(problem, k, a, flat) for k in range(len(problem.pieces)))
                for a in problem.rig.actuator_names
            ]
        )
    for j, a in enumerate(problem.rig.actuator_names):
        mine = np.array([row[j] for row in sizes])
        best = int(np.argmin(mine))
        if mine[best] < mine[0] - CLEARER * len(problem.pieces):
            out[problem.table.index(f"{a}.transport_delay.delay")] += DELAYS_S[best]
    return out


def _refined(
    problem: Problem, found: dict[tuple[int, str], Ticks], vector: Array
) -> dict[tuple[int, str], Ticks]:
    """The same ticks, placed so that frames which come near one act where the record says they did."""
    if not found:
        return found

    def steps_of(clocks: Mapping[tuple[int, str], Ticks]) -> dict[tuple[int, str], Array]:
        flat = problem.with_clocks(clocks).predict(vector)[0]
        return {
            key: np.concatenate(
                [s[0, kept] for _, s, kept in fine_structure(problem, *key, [flat])]
            )
            for key in clocks
        }

    turns = [(most, _moving(problem, name, step)) for name, step, most in TURNS]
    return fewest_jumps(found, turns, steps_of)[0]


def _moving(
    problem: Problem, name: str, step: float
) -> Callable[[tuple[int, str], Ticks, int], Ticks]:
    """What moves one number of ticks by so many `step`s; the rate about the middle of the stretch."""

    def moved(key: tuple[int, str], ticks: Ticks, count: int) -> Ticks:
        by = count * step
        if name != "rate":
            late = {name: getattr(ticks, name) + by * problem.rig.bus.position_loop}
            return replace(ticks, **late)
        start, end = problem.pieces[key[0]].span_s
        turn = by * (0.5 * (start + end) - ticks.origin_s)
        return replace(ticks, rate=ticks.rate + by, phase_s=ticks.phase_s - turn)

    return moved


def _best(
    problem: Problem, stretch: int, actuator: str, flats: Sequence[Array], tick: float
) -> Ticks | None:
    sizes, centres, count = [], [], 0
    for t, steps, kept in fine_structure(problem, stretch, actuator, flats):
        for start in np.arange(t[0], t[-1], WINDOW_S):
            inside = ((t >= start) & (t < start + WINDOW_S))[1:] & kept
            if inside.sum() >= ENOUGH:
                sizes.append(
                    np.log(
                        np.mean(np.minimum(steps[:, inside], _cap(steps[0])) ** 2, axis=1) + 1e-300
                    )
                )
                centres.append(start + 0.5 * WINDOW_S)
                count += int(inside.sum())
    if len(sizes) < 3:
        return None
    table = 0.5 * np.array(sizes)
    t = np.array(centres)
    origin = float(t[0])
    # a smooth curve over the places of the ticks, periodic
    grid = np.arange(FINE) / FINE
    spectrum = np.fft.rfft(table[:, 1:], axis=1)
    padded = np.zeros((len(t), FINE // 2 + 1), dtype=complex)
    padded[:, : spectrum.shape[1]] = spectrum
    padded[:, PLACES // 2] *= 0.5
    curve = np.fft.irfft(padded, FINE, axis=1) * (FINE / PLACES)
    best, where = np.inf, (0.0, 0.0)
    rows = np.arange(len(t))
    for rate in np.arange(-FASTEST, FASTEST + 1e-12, RATE_STEP):
        shift = rate * (t - origin) / tick
        unlikely = 0.5 * (rate / USUAL) ** 2 / count
        for g in grid:
            k = np.round((g + shift) * FINE).astype(np.int64) % FINE
            total = float(np.mean(curve[rows, k])) + unlikely
            if total < best:
                best, where = total, (float(g * tick), float(rate))
    if best > float(np.mean(table[:, 0])) - CLEARER:
        return None
    return Ticks(where[0], where[1], origin)


def _cap(steps: Array) -> float:
    return float(6.0 * np.median(steps) + 1e-12)
