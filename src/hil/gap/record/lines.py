"""Where setpoints are forces: whether drives take each at once, or draw it out in a line of a cycle.

The force that a drive answers is what it was told, so its answers say which, if only they are not all taken
right where setpoints come. Either is asked with the delay and the scale and bias at which it leaves least. A
force that is taken at once is not there at once: the current loop lags, and the drive may take it at its next
tick. Where answers come just then, they lie between two setpoints as on a line.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hil.config import Bus, RigFile
from hil.identify.replay import Series, Stretch

Array = NDArray[np.float64]

LONGEST: Final = 2.0
FINEST: Final = 0.02
"""Cycles: the longest delay that is looked for, and in what steps."""
PLACES: Final = tuple(np.arange(10) / 10.0)
"""Ticks: where a drive's may lie, of those that are tried; the best place is looked at more nearly."""
WAITS: Final = 9
"""Delays that are tried beside each, over a tick either way."""
OUTLIER: Final = 4.0
"""Robust spreads from which on an answer says no more."""
CLEAR: Final = 6.0
"""Nats that tell [of all runs of a case; set on tuning seeds 5001 to 5003: 10 and more where drives draw
lines, or 3 where answers are taken just where setpoints come; 1 at most where they do not]."""
UNTOLD: Final = 2.0
"""Nats from which on drives may draw lines, and a twin that does and leaves no gap says so [the same seeds:
1 at most of those that do not, of twelve that do two have 3]."""


def for_lines(rig: RigFile, pieces: Sequence[Stretch]) -> float:
    """By how many nats lines explain the forces that the drives answered better than steps do, in `pieces` of
    mode "force"; from CLEAR on drives draw lines, down to -CLEAR they may."""
    return sum((_nats(rig, p) for p in pieces), 0.0)


def _nats(rig: RigFile, piece: Stretch) -> float:
    out = 0.0
    for a in rig.actuators:
        told = piece.setpoints.get(a.name, (np.empty(0), np.empty(0)))
        for signal in (f"{a.name}.force", f"{a.name}.current"):
            t, value = piece.samples.get(signal, (np.empty(0), np.empty(0)))
            if len(t) > 2 and len(told[0]) > 2:
                answers = t - rig.bus.answer_delay, value
                lag_s = 1.0 / (2.0 * np.pi * a.current_hz)
                held = _held(rig.bus, told, answers, lag_s)
                out += 0.5 * len(t) * float(np.log(held / _drawn(rig.bus, told, answers)))
    return out


def _drawn(bus: Bus, told: Series, answers: Series) -> float:
    """Mean square that lines leave of the answers at the delay at which least is; never 0."""
    sent, wanted = told
    begins = _begins(sent, wanted, bus.cycle)

    def left(acts: Array) -> float:
        return _left(acts, begins, wanted, answers, lambda s: np.minimum(s / bus.cycle, 1.0))

    return min(left(sent + bus.setpoint_delay + delay_s) for delay_s in _delays(bus))


def _held(bus: Bus, told: Series, answers: Series, lag_s: float) -> float:
    """The same of steps that a current loop follows `lag_s` late, at once or from a tick of the drive on."""
    sent, wanted = told
    begins, tick = np.concatenate([wanted[:1], wanted[:-1]]), bus.position_loop
    there = sent + bus.setpoint_delay

    def left(acts: Array) -> float:
        return _left(acts, begins, wanted, answers, lambda s: 1.0 - np.exp(-s / lag_s))

    def at_ticks(late_s: float, place: float) -> Array:
        acts = np.ceil((there + max(late_s, 0.0) - place) / tick) * tick + place
        return np.asarray(np.maximum.accumulate(acts))

    least, best_s = min((left(there + s), s) for s in _delays(bus))
    finer = best_s + FINEST * bus.cycle * np.linspace(-1.0, 1.0, WAITS)
    least = min(least, *(left(there + max(s, 0.0)) for s in finer))
    grid = [(best_s + w * tick, p * tick) for w in np.linspace(-1.0, 1.0, WAITS) for p in PLACES]
    found, late_s, place = min((left(at_ticks(*x)), *x) for x in grid)
    nearer = [(late_s, place + 0.1 * p * tick) for p in np.linspace(-1.0, 1.0, WAITS)]
    return min(least, found, *(left(at_ticks(*x)) for x in nearer))


def _delays(bus: Bus) -> Array:
    return np.arange(0.0, LONGEST, FINEST) * bus.cycle


def _begins(sent: Array, wanted: Array, cycle_s: float) -> Array:
    """Where the line to each setpoint begins: at what the line before has reached."""
    out = np.empty(len(wanted))
    now = wanted[0]
    out[0] = now
    for k in range(1, len(wanted)):
        now += (wanted[k - 1] - now) * min((sent[k] - sent[k - 1]) / cycle_s, 1.0)
        out[k] = now
    return out


def _left(
    acts: Array, begins: Array, wanted: Array, answers: Series, share: Callable[[Array], Array]
) -> float:
    """Mean square of the answers beside the nearest scale and bias of forces that go from `begins` to
    `wanted` from `acts` on, of which `share` is done so long after; outliers cut off."""
    t, value = answers
    k = np.searchsorted(acts, t, side="right") - 1
    known = k >= 0
    at = k[known]
    force = begins[at] + share(t[known] - acts[at]) * (wanted[at] - begins[at])
    columns = np.column_stack([force, np.ones(len(force))])
    rest = value[known] - columns @ np.linalg.lstsq(columns, value[known], rcond=None)[0]
    most = OUTLIER * 1.4826 * float(np.median(np.abs(rest)))
    return max(float(np.mean(np.minimum(rest**2, most**2))), 1e-18)
