"""Where setpoints are forces: whether drives take each at once, or draw it out in a line of a cycle.

The force that a drive answers is what it was told, so its answers say which, if only they are not all taken
right where setpoints come. Either is asked with the delay and the scale and bias at which it leaves least.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hil.config import RigFile
from hil.identify.replay import Series, Stretch

Array = NDArray[np.float64]

LONGEST: Final = 2.0
FINEST: Final = 0.02
"""Cycles: the longest delay that is looked for, and in what steps."""
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
                held, drawn = (_misfit(rig, told, answers, lines) for lines in (False, True))
                out += 0.5 * len(t) * float(np.log(held / drawn))
    return out


def _misfit(rig: RigFile, told: Series, answers: Series, is_line: bool) -> float:
    """Mean square that is left of the answers at the delay at which least is; never 0."""
    (sent, wanted), (t, value), cycle = told, answers, rig.bus.cycle
    begins = _begins(sent, wanted, cycle) if is_line else wanted
    least = np.inf
    for delay in np.arange(0.0, LONGEST, FINEST) * cycle:
        acts = sent + rig.bus.setpoint_delay + delay
        k = np.searchsorted(acts, t, side="right") - 1
        after, at = t[k >= 0], k[k >= 0]
        share = np.minimum((after - acts[at]) / cycle, 1.0) if is_line else 1.0
        force = begins[at] + share * (wanted[at] - begins[at])
        least = min(least, _left(force, value[k >= 0]))
    return least


def _begins(sent: Array, wanted: Array, cycle_s: float) -> Array:
    """Where the line to each setpoint begins: at what the line before has reached."""
    out = np.empty(len(wanted))
    now = wanted[0]
    out[0] = now
    for k in range(1, len(wanted)):
        now += (wanted[k - 1] - now) * min((sent[k] - sent[k - 1]) / cycle_s, 1.0)
        out[k] = now
    return out


def _left(force: Array, value: Array) -> float:
    """Mean square of `value` beside the nearest scale and bias of `force`, outliers cut off."""
    columns = np.column_stack([force, np.ones(len(force))])
    rest = value - columns @ np.linalg.lstsq(columns, value, rcond=None)[0]
    most = OUTLIER * 1.4826 * float(np.median(np.abs(rest)))
    return max(float(np.mean(np.minimum(rest**2, most**2))), 1e-18)
