"""Where setpoints are forces: on which side of a jump of theirs each answered force stands.

Such setpoints jump with each frame, by what a noisy loop makes of them, and frames and answers wait for
each other on the bus, by more than a millisecond where six drives share it. What the drive answers is the
force that was set, before the jump or after it, whatever the stamps say. So an answer near a jump is taken
for that of the side that it is nearer to and told in the middle of it, where no wait matters; one between the
two, of a current on its way, says nothing and is left out.
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
"""Standard deviations of a sensor by which a force is between two others."""


def sided(rig: RigFile, piece: Stretch) -> Stretch:
    """`piece` with its answered forces and currents on their sides; as it is in mode "position"."""
    if piece.mode != "force":
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
    acts, sampled = sent + rig.bus.setpoint_delay, t_s - rig.bus.answer_delay
    last = len(acts) - 1
    now = np.clip(np.searchsorted(acts, sampled) - 1, 0, last)
    behind = np.where(now > 0, sampled - acts[now], np.inf)
    ahead = np.where(now < last, acts[np.minimum(now + 1, last)] - sampled, np.inf)
    other = np.clip(np.where(behind < ahead, now - 1, now + 1), 0, last)
    near = np.minimum(np.abs(behind), np.abs(ahead)) < NEAR * rig.bus.cycle
    to_now, to_other = value - told[now], value - told[other]
    between = (np.minimum(np.abs(to_now), np.abs(to_other)) > most) & (to_now * to_other < 0.0)
    mine = np.where(np.abs(to_other) < np.abs(to_now), other, now)
    ends = np.append(acts[1:], acts[-1] + rig.bus.cycle)
    placed = np.where(near, 0.5 * (acts + ends)[mine] + rig.bus.answer_delay, t_s)
    kept = ~(near & between)
    return np.maximum.accumulate(placed[kept]), value[kept]
