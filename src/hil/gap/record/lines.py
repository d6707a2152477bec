"""Where setpoints are forces: whether drives take each at once, or draw it out in a line of a cycle.

The force that a drive answers is what it was told, so its answers say which, if only they are not all taken
right where setpoints come. Either is weighed over all delays, each with the scale and bias that leave least.
A force that is taken at once is not there at once: the current loop lags, and the drive may take it at its
next tick. Where answers come just then, they lie between two setpoints as on a line.
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
"""Cycles: the longest delay that is looked for, and in what steps; each as likely as the others."""
PLACES: Final = 20
"""Places of a drive's ticks that are tried, each as likely as the others."""
MOST: Final = 4000
"""Answers of a signal that are asked, of more every so many."""
OUTLIER: Final = 4.0
"""Robust spreads from which on an answer says no more."""
CLEAR: Final = 6.0
"""Nats that tell [of all runs of a case; set on tuning seed 5004: of fourteen whose drives draw lines six
have 9 and more, of as many that do not none more than -3]."""
UNTOLD: Final = -1.5
"""Nats from which on drives may draw lines, and a twin that does and leaves no gap says so [the same seed:
five more of those that do]."""


def for_lines(rig: RigFile, pieces: Sequence[Stretch]) -> float:
    """By how many nats lines explain the forces that the drives answered better than steps do, in `pieces` of
    mode "force"; from CLEAR on drives draw lines, down to UNTOLD they may."""
    return sum((_nats(rig, p) for p in pieces), 0.0)


def _nats(rig: RigFile, piece: Stretch) -> float:
    out = 0.0
    for a in rig.actuators:
        told = piece.setpoints.get(a.name, (np.empty(0), np.empty(0)))
        for signal in (f"{a.name}.force", f"{a.name}.current"):
            t, value = piece.samples.get(signal, (np.empty(0), np.empty(0)))
            if len(t) > 2 and len(told[0]) > 2:
                every = 1 + (len(t) - 1) // MOST
                answers = t[::every] - rig.bus.answer_delay, value[::every]
                lag_s = 1.0 / (2.0 * np.pi * a.current_hz)
                out += _drawn(rig.bus, told, answers) - _held(rig.bus, told, answers, lag_s)
    return out


def _drawn(bus: Bus, told: Series, answers: Series) -> float:
    """Nats of the answers where lines are drawn, however late."""
    sent, wanted = told
    begins = _begins(sent, wanted, bus.cycle)

    def nats(acts: Array) -> float:
        return _likely(acts, begins, wanted, answers, lambda s: np.minimum(s / bus.cycle, 1.0))

    return _mean([nats(sent + bus.setpoint_delay + s) for s in _delays(bus)])


def _held(bus: Bus, told: Series, answers: Series, lag_s: float) -> float:
    """The same of steps that a current loop follows `lag_s` late, at once or, as likely, from a tick of the
    drive on."""
    sent, wanted = told
    begins, tick = np.concatenate([wanted[:1], wanted[:-1]]), bus.position_loop

    def nats(acts: Array) -> float:
        return _likely(acts, begins, wanted, answers, lambda s: 1.0 - np.exp(-s / lag_s))

    def at_ticks(late_s: float) -> float:
        places = tick * np.arange(PLACES) / PLACES
        late = sent + bus.setpoint_delay + late_s
        return _mean([nats(np.ceil((late - p) / tick) * tick + p) for p in places])

    delays = _delays(bus)
    at_once = [nats(sent + bus.setpoint_delay + s) for s in delays]
    best_s = delays[int(np.argmax(at_once))]
    near = np.abs(delays - best_s) <= tick  # others have no part in the mean
    waiting = [at_ticks(s) if is_near else -np.inf for s, is_near in zip(delays, near, strict=True)]
    return float(np.logaddexp(_mean(at_once), _mean(waiting)) - np.log(2.0))


def _mean(nats: Sequence[float]) -> float:
    """Of what as many readings, each as likely, have for them."""
    return float(np.logaddexp.reduce(nats) - np.log(len(nats)))


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


def _likely(
    acts: Array, begins: Array, wanted: Array, answers: Series, share: Callable[[Array], Array]
) -> float:
    """Nats of the answers beside the nearest scale and bias of forces that go from `begins` to `wanted` from
    `acts` on, of which `share` is done so long after; outliers cut off."""
    t, value = answers
    k = np.searchsorted(acts, t, side="right") - 1
    known = k >= 0
    at = k[known]
    force = begins[at] + share(t[known] - acts[at]) * (wanted[at] - begins[at])
    columns = np.column_stack([force, np.ones(len(force))])
    rest = value[known] - columns @ np.linalg.lstsq(columns, value[known], rcond=None)[0]
    most = OUTLIER * 1.4826 * float(np.median(np.abs(rest)))
    size = max(float(np.mean(np.minimum(rest**2, most**2))), 1e-18)
    return -0.5 * len(t) * float(np.log(size))
