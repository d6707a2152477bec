"""Where setpoints are forces: on which side of a jump of theirs each answered force stands.

Such setpoints jump with each frame, by what a noisy loop makes of them, and frames and answers wait for
each other on the bus, by more than a millisecond where six drives share it. What the drive answers is the
force that was set, before the jump or after it, whatever the stamps say. So the delay is looked for with
which most answers are what was set. Where some are still of the other side of a jump, each that is near one
is taken for that of the side that it is nearer to and told in the middle of it, where no wait matters; one
between the two, of a current on its way, says nothing and is left out.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hil.config import RigFile
from hil.identify.replay import Series, Stretch

Array = NDArray[np.float64]

NEAR: Final = 0.25
"""Of a cycle, within which a force that was set may be there or not."""
STANDS_OUT: Final = 3.0
"""Standard deviations of a sensor by which a force is another."""
ASTRAY: Final = 0.002
"""Of the answers on the wrong side or on the way: from there on no stamp is believed."""
LONGEST: Final = 2.0
FINEST: Final = 0.025
"""Cycles: the longest delay that is looked for, and in what steps."""
ALIKE: Final = 1.01
"""Ratio of misfits that are the same: the shortest of such delays counts."""


def sided(rig: RigFile, piece: Stretch) -> Stretch:
    """`piece` with its answered forces and currents on their sides; as it is in mode "position", and where
    drives draw forces out: lines have no jumps."""
    if piece.mode != "force" or rig.bus.force_interpolation != "hold":
        return piece
    moved = {}
    for a in rig.actuators:
        t, told = piece.setpoints.get(a.name, (np.empty(0), np.empty(0)))
        for signal, unit, noise in (
            (f"{a.name}.force", 1.0, (rig.noise.force, rig.noise.force_step)),
            (f"{a.name}.current", a.force_per_ampere, (rig.noise.current, rig.noise.current_step)),
        ):
            if signal in piece.samples and len(t) > 2 and unit is not None:
                most = STANDS_OUT * max(noise)
                moved[signal] = _sided(rig, (t, told / unit), piece.samples[signal], most)
    return replace(piece, samples={**piece.samples, **moved})


def _sided(rig: RigFile, setpoints: Series, answers: Series, most: float) -> Series:
    """`answers` in the unit of the `setpoints`, of which `most` is noise."""
    (sent, told), (t_s, value) = setpoints, answers
    cycle, sampled = rig.bus.cycle, t_s - rig.bus.answer_delay
    acts = sent + rig.bus.setpoint_delay
    acts = acts + _delay_s(acts, told, sampled, value, most, cycle)
    last = len(acts) - 1
    now = np.clip(np.searchsorted(acts, sampled) - 1, 0, last)
    behind = np.where(now > 0, sampled - acts[now], np.inf)
    ahead = np.where(now < last, acts[np.minimum(now + 1, last)] - sampled, np.inf)
    other = np.clip(np.where(behind < ahead, now - 1, now + 1), 0, last)
    near = np.minimum(np.abs(behind), np.abs(ahead)) < NEAR * cycle
    to_now, to_other = value - told[now], value - told[other]
    between = near & (np.abs(to_now) > most) & (to_now * to_other < 0.0)
    beyond = near & (np.abs(to_other) < most) & (np.abs(to_now) > most)
    if np.mean(between | beyond) <= ASTRAY:
        return answers
    between &= np.abs(to_other) > most
    mine = np.where(np.abs(to_other) < np.abs(to_now), other, now)
    middle = 0.5 * (acts + np.append(acts[1:], acts[-1] + cycle))
    placed = np.where(near, middle[mine] + rig.bus.answer_delay, t_s)
    placed, value = np.maximum.accumulate(placed[~between]), value[~between]
    is_first = np.diff(placed, prepend=-np.inf) > 0.0  # two that are told in one middle are one
    return placed[is_first], value[is_first]


def _delay_s(
    acts: Array, told: Array, sampled: Array, value: Array, most: float, cycle_s: float
) -> float:
    """By how much later than `acts` the forces `told` seem to act; misfits count up to `most`."""
    delays = np.arange(0.0, LONGEST, FINEST) * cycle_s
    misfits = []
    for delay_s in delays:
        now = np.clip(np.searchsorted(acts + delay_s, sampled) - 1, 0, len(acts) - 1)
        misfits.append(float(np.mean(np.minimum(np.abs(value - told[now]), most))))
    alike = np.array(misfits) <= ALIKE * min(misfits)
    return float(delays[np.argmax(alike)])
