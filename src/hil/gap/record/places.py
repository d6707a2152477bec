"""Where a drive's ticks lie: places that make its force clearer than any delay does.

Two things tell. Frames that come near a tick act now at one and now at the next, which kicks the drive; and a
force that is read within a tick of a setpoint has seen the loop's answer or has not, most of all where the
drive rests at setpoints. For the second it matters as much how late the drive answers, so that is looked for
along with the place; what frames make of the place alone, calibration makes of the rest.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from hil.gap.record.fineness import CLEARER, fine_structure
from hil.gap.record.problem import Problem
from hil.gap.record.ticks import Ticks

Array = NDArray[np.float64]

PLACES: Final = 32
"""Places of the ticks that are replayed."""
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


def find_places(problem: Problem, vector: Array) -> tuple[dict[tuple[int, str], Ticks], Array]:
    """The drives of which some place of the ticks makes their force clearer than any delay does, and that
    place; `vector` (P,) with answers as late as they then seem."""
    rig, pieces = problem.rig, problem.pieces
    tick, late_s = rig.bus.position_loop, [k * rig.bus.position_loop for k in LATE]
    own = [problem.table.index(f"{a}.transport_delay.delay") for a in rig.actuator_names]
    without = []
    for by in SHIFTS:
        row = np.array(vector)
        row[own] += by * tick
        without.append(problem.forces_late(row, late_s))
    flats = []
    for p in range(PLACES):
        ticks = Ticks(p * tick / PLACES, 0.0, 0.0)
        clocks = {(k, a): ticks for k in range(len(pieces)) for a in rig.actuator_names}
        flats.append(problem.with_clocks(clocks).forces_late(vector, late_s))
    found, answered = {}, np.array(vector)
    for a in rig.actuator_names:
        answers_s = []
        for k in range(len(pieces)):
            best = _best(problem, k, a, np.array(without + flats))
            if pieces[k].mode == "position" and best is not None:
                found[k, a] = best[0]
                answers_s.append(best[1])
        if answers_s:
            for q in ("force", "current"):
                answered[problem.table.index(f"{a}.{q}.sensor_latency.delay")] += float(
                    np.median(answers_s)
                )
    return found, answered


def _best(
    problem: Problem, stretch: int, actuator: str, flats: Array
) -> tuple[Ticks, float] | None:
    """Ticks of one drive and how late it answers, s; `flats` (SHIFTS + PLACES, LATE, N): what the twin does
    without ticks and with them at each place."""
    tick = problem.rig.bus.position_loop
    tables = []
    t, count = np.empty(0), 0
    for late in range(len(LATE)):
        sizes, centres, count = [], [], 0
        for stamps, steps, kept in fine_structure(problem, stretch, actuator, list(flats[:, late])):
            most = _cap(steps[SHIFTS.index(0.0)])
            for start in np.arange(stamps[0], stamps[-1], WINDOW_S):
                inside = ((stamps >= start) & (stamps < start + WINDOW_S))[1:] & kept
                if inside.sum() >= ENOUGH:
                    own = np.minimum(steps[:, inside], most) ** 2
                    sizes.append(np.log(np.mean(own, axis=1) + 1e-300))
                    centres.append(start + 0.5 * WINDOW_S)
                    count += int(inside.sum())
        if len(sizes) < 3:
            return None
        tables.append(0.5 * np.array(sizes))
        t = np.array(centres)
    origin = float(t[0])
    without, at_places = np.split(np.array(tables), [len(SHIFTS)], axis=2)
    best, where = np.inf, (Ticks(0.0, 0.0, origin), 0.0)
    rows = np.arange(len(t))
    for rate in np.arange(-FASTEST, FASTEST + 1e-12, RATE_STEP):
        shift = rate * (t - origin) / tick
        unlikely = 0.5 * (rate / USUAL) ** 2 / count
        for p in range(PLACES):
            k = np.round(p + shift * PLACES).astype(np.int64) % PLACES
            totals = np.mean(at_places[:, rows, k], axis=1) + unlikely
            least = int(np.argmin(totals))
            if totals[least] < best:
                best = float(totals[least])
                where = Ticks(p * tick / PLACES, float(rate), origin), LATE[least] * tick
    return where if best <= float(np.mean(without, axis=1).min()) - CLEARER else None


def _cap(steps: Array) -> float:
    return float(6.0 * np.median(steps) + 1e-12)
