"""Drives on a bus with SYNC: they take each target when SYNC comes, however its frame jittered.

Where force has the finer structure of setpoints at regular instants, that is so, and where it tells of
neither it is taken for so: loops keep step with SYNC. Such a drive may still act at the next tick of a clock
of its own, which runs off that of the bus: it gets later and later by up to a tick and is early again. A
position shows that in proportion to its speed.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hil.compiled import compiled
from hil.gap.record.fineness import CLEARER, fineness, quiet
from hil.gap.record.latecomers import Synced, with_latecomers
from hil.gap.record.problem import FORCES, Problem, Series, predict_all
from hil.gap.record.ticks import AtSync, Ticks

Array = NDArray[np.float64]

FASTEST: Final = 1e-4
"""s/s that a drive's clock may run off the bus's [M: crystals 50 ppm each]."""
TICKS: Final = 0.25
"""Log of what a position leaves, root mean square, that ticks must take off to be believed: a constant delay
is no tick, and what goes with speed in other ways falls out of step with any."""
QUIET: Final = 0.7
"""Log of a force's fine structure over that of noise, up to which SYNC and late frames may leave it. Told one
by one those take some off any; drives at SYNC had 0.2 left (six soft legs 0.5), those of other buses 1.1 and
more [set on axis 135 and used-up cases of two worlds]."""
IN_STEP: Final = 0.25
"""Of a cycle, that frames may jitter by and are told by SYNC when to act, if nothing speaks against it."""
ROUNDS: Final = (
    (1500, FASTEST, 2e-6, 0.5, 1.0 / 32.0),
    (3000, 2e-6, 2e-7, 1.0 / 16.0, 1.0 / 256.0),
    (12000, 2e-7, 2e-8, 1.0 / 128.0, 1.0 / 2048.0),
)  # fmt: skip
"""Of a search: the most samples of a position looked at; rates either way and their step, s/s; places either
way and their step, ticks."""
SLIPS_S: Final = tuple(0.001 * k for k in range(-40, 13, 2))
"""By which a drive may be early again later than its position says: that follows in some 30 ms."""


def at_sync(problem: Problem, vector: Array) -> Synced:
    """The drives of each stretch whose setpoints act at SYNC: the force of all of them says so, by itself or
    beside the frames that come too late for it, or does not say that they act as they were sent.

    `vector` (P,): the twin that they are looked at beside.
    """
    synced = AtSync(problem.rig.bus.cycle)
    stretches = [k for k, p in enumerate(problem.pieces) if p.mode == "position"]
    tried: Synced = {(k, a): synced for k in stretches for a in problem.rig.actuator_names}
    as_sent, regular = predict_all([problem, problem.with_clocks(tried)], vector)
    found = _clearer(problem, tried, as_sent, regular)
    usual = _clearer(problem, _in_step(problem, tried), as_sent, regular, -CLEARER, np.inf)
    for x in problem.series:
        if x.quantity == "position" and (key := (x.stretch, x.actuator)) in found:
            found[key] = AtSync(synced.cycle_s, _ticks(problem, x, regular[x.part]))
    if any(s.ticks for s in found.values()):
        found = _slid(problem, found, vector)
    late = with_latecomers(problem, {**tried, **found}, vector)
    beside_late = problem.with_clocks(late).predict(vector)[0]
    return usual | found | _clearer(problem, late, as_sent, beside_late)


def _in_step(problem: Problem, clocks: Synced) -> Synced:
    """Those of `clocks` whose frames come once a cycle."""

    def jitter_s(k: int, actuator: str, synced: AtSync) -> float:
        sent, _ = problem.sent[k].setpoints[actuator]
        return float(np.std(sent - synced.regular(sent)))

    return {key: s for key, s in clocks.items() if jitter_s(*key, s) < IN_STEP * s.cycle_s}


def _clearer(
    problem: Problem,
    clocks: Synced,
    as_sent: Array,
    other: Array,
    least: float = CLEARER,
    loudest: float = QUIET,
) -> Synced:
    """Those of `clocks` in whose stretches force has by `least` less of a structure of its own beside `other`
    (N,), the twin with these clocks, than beside setpoints that act `as_sent` (N,), and by no more than
    `loudest` more than the sensors' noise has."""
    off = dict.fromkeys([k for k, _ in clocks], 0.0)
    loud = dict(off)
    for k, a in clocks:
        left = fineness(problem, k, a, other)
        off[k] += fineness(problem, k, a, as_sent) - left
        loud[k] += left - quiet(problem, k, a)
    n = len(problem.rig.actuator_names)
    return {
        key: s
        for key, s in clocks.items()
        if off[key[0]] > least * n and loud[key[0]] < loudest * n
    }


def _slid(problem: Problem, found: Synced, vector: Array) -> Synced:
    """The same drives, each early again when its force is kicked: positions tell that late."""

    def moved(by_s: float) -> Synced:
        return {
            key: s if s.ticks is None else replace(s, ticks=s.ticks.later(by_s))
            for key, s in found.items()
        }

    tried = [moved(by_s) for by_s in SLIPS_S]
    slid = predict_all([problem.with_clocks(clocks) for clocks in tried], vector)
    lefts = [problem.measured - flat for flat in slid]
    kicks = {key: np.zeros(len(tried)) for key in found}
    for x in problem.series:
        if x.quantity in FORCES and (key := (x.stretch, x.actuator)) in kicks:
            kept = problem.kept[x.part]
            kicks[key] += [float(np.sum(left[x.part][kept] ** 2)) for left in lefts]
    return {key: tried[int(np.argmin(size))][key] for key, size in kicks.items()}


@dataclass(frozen=True, slots=True)
class _Late:
    """What a position leaves (N,) beside a twin of `speed` (N,), by setpoints that come at `t` (N,)."""

    t: Array
    origin_s: float
    left: Array
    speed: Array
    tick_s: float

    def size(self, rates: Array, places: Array) -> Array:
        """(R, P) mean square that is left beside such rates (R,) and places of ticks (P,), in ticks, and the
        constant delay that leaves least."""
        out = np.empty((len(rates), len(places)))
        since = self.t - self.origin_s
        _left_beside(
            since, self.t / self.tick_s, self.left, self.speed, self.tick_s, rates, places, out
        )
        return out

    @property
    def plain(self) -> float:
        """Mean square that is left beside a drive without ticks."""
        share = self.left @ self.speed / max(float(self.speed @ self.speed), 1e-300)
        return float(np.mean((self.left - share * self.speed) ** 2))


@compiled
def _left_beside(
    since: Array,
    ticks: Array,
    left: Array,
    speed: Array,
    tick_s: float,
    rates: Array,
    places: Array,
    out: Array,
) -> None:
    """Fill `out` (R, P) as `_Late.size` says, of samples `since` (N,) s after the clock's start, at `ticks`
    (N,) of it."""
    count = len(left)
    power = max(np.sum(speed * speed), 1e-300)
    rest = np.empty(count)
    for r in range(len(rates)):
        for p in range(len(places)):
            along = 0.0
            for i in range(count):
                turned = places[p] + rates[r] * since[i] / tick_s - ticks[i]
                rest[i] = left[i] + tick_s * speed[i] * (turned - math.floor(turned) - 0.5)
                along += rest[i] * speed[i]
            total = 0.0
            for i in range(count):
                total += (rest[i] - along / power * speed[i]) ** 2
            out[r, p] = total / count


def _ticks(problem: Problem, x: Series, predicted: Array) -> Ticks | None:
    """The ticks of a drive's own clock that its position shows; None where it shows none."""
    rows = np.flatnonzero(problem.kept[x.part])
    bus, t = problem.rig.bus, problem.t_s[x.part]
    speed = np.gradient(predicted, t)
    if not speed[rows].any():
        return None
    sent = AtSync(bus.cycle).regular(problem.sent[x.stretch].setpoints[x.actuator][0])
    there = sent + bus.setpoint_delay
    acted = there[np.maximum(np.searchsorted(there, t - bus.answer_delay) - 1, 0)]
    left = problem.measured[x.part] - predicted
    rate, place, gain = 0.0, 0.5, 0.0
    for most, wide, step, far, fine in ROUNDS:
        some = rows[:: len(rows) // most + 1]
        late = _Late(acted[some], there[0], left[some], speed[some], bus.position_loop)
        rates = rate + np.arange(-wide, wide + 0.5 * step, step)
        places = place + np.arange(-far, far, fine)
        size = late.size(rates, places)
        i, j = np.unravel_index(int(np.argmin(size)), size.shape)
        rate, place = float(rates[i]), float(places[j])
        gain = 0.5 * float(np.log(late.plain / max(size[i, j], 1e-300)))
    return Ticks(place * bus.position_loop, rate, float(there[0])) if gain > TICKS else None
