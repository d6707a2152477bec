"""Setpoints that come just too late: a frame that waits for the bus acts a tick after its fellows.

No stamp tells how long a frame waited. But a drive that takes a setpoint a tick late answers with a kick of
force, at an instant and of a shape that the twin knows: each frame is asked whether its kick is there. Of two
late frames in a row only the second is told: the lag of the first goes on without a kick.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hil.compiled import compiled
from hil.gap.record.problem import FORCES, Problem, predict_all
from hil.gap.record.ticks import AtSync, Key

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Indices = NDArray[np.int64]
Synced = dict[Key, AtSync]

APART: Final = 8
"""Every so many frames are late in one replay, whose kicks then do not meet."""
LASTS: Final = 4
"""Cycles in which a kick is looked for: what comes after them is small."""
ONE: Final = (0.5, 1.7)
"""Times the twin's kick that a kick must be: a frame that was lost makes one several times as large."""
SURE: Final = 6.0
"""Nats that must speak for a frame's kick: of ten thousands no more than FEW are there by chance."""
TOLD: Final = 12.0
"""Nats that a frame's kick must be worth for the frame to be told at all."""
ROUNDS: Final = 6
"""The most: in each a frame is asked beside what is known of its neighbours, and noise is what they leave."""
FEW: Final = 10
"""Late frames of a drive up to which they are no habit of its bus."""
OFTEN: Final = 2
"""Times the kicks the other way, which no late frame makes, that late frames must be as many as besides."""


def with_latecomers(problem: Problem, found: Mapping[Key, AtSync], vector: Array) -> Synced:
    """The same drives, each with the frames that its force says to have acted a tick late.

    `vector` (P,): the twin that they are looked at beside.
    """
    out, bus = dict(found), problem.rig.bus
    if not out or bus.position_loop >= bus.cycle:  # a frame a tick late would be the next one
        return out
    sent = {key: problem.sent[key[0]].setpoints[key[1]][0] for key in out}
    tried = [
        {key: replace(s, late=tuple(sent[key][m::APART].tolist())) for key, s in out.items()}
        for m in range(APART)
    ]
    base, *some = predict_all([problem.with_clocks(clocks) for clocks in (out, *tried)], vector)
    kicks = [flat - base for flat in some]
    for x in problem.series:
        key = (x.stretch, x.actuator)
        if x.quantity in FORCES and key in found and not out[key].late:
            own = [k[x.part] for k in kicks]
            left = np.where(problem.kept[x.part], problem.measured[x.part] - base[x.part], 0.0)
            due = found[key].regular(sent[key])
            told = told_late(problem.t_s[x.part], left, own, due, found[key].cycle_s)
            if told is not None:
                late, untold = told
                out[key] = replace(
                    found[key],
                    late=tuple(sent[key][late].tolist()),
                    untold=tuple(sent[key][untold].tolist()),
                    share=float(late.sum() / (~untold).sum()),
                )
    return out


def told_late(
    t: Array, left: Array, kicks: list[Array], sent: Array, cycle_s: float
) -> tuple[Flags, Flags] | None:
    """Which frames sent at `sent` (K,) s act a tick late, and which nobody can tell; None where no more seem
    to than by chance.

    left: (N,) of a force at instants `t` (N,) s; kicks: APART of (N,), what one frame in so many makes of it.
    What no late frame makes, kicks the other way, says how many are there by chance: a twin at odds with the
    record leaves both alike. Those are looked for in what the late frames leave, for what comes after a late
    one looks like them.
    """
    first = np.maximum(np.searchsorted(t, sent) - 1, 0)
    last = np.searchsorted(t, sent + LASTS * cycle_s)
    step, shapes = np.diff(left), np.diff(np.array(kicks), axis=1)
    late, untold = _late(step, shapes, first, last)
    by_chance, _ = _late(step, -shapes, first, last)
    return (late, untold) if late.sum() > FEW + OFTEN * by_chance.sum() else None


def _late(step: Array, shapes: Array, first: Indices, last: Indices) -> tuple[Flags, Flags]:
    """Which frames (K,) are late, for their kick is in `step` (N - 1,), from which those are taken, and which
    nobody can tell, for noise would hide it; arguments as of `_asked`."""
    late, untold = np.zeros(len(first), dtype=bool), np.zeros(len(first), dtype=bool)
    for _ in range(ROUNDS):
        noise = (1.4826 * float(np.median(np.abs(step)))) ** 2
        if not _asked(step, shapes, first, last, noise, late, untold):
            break
    return late, untold


@compiled
def _asked(
    step: Array,
    shapes: Array,
    first: Indices,
    last: Indices,
    noise: float,
    late: Flags,
    untold: Flags,
) -> bool:
    """Ask each frame once: whether its kick, of those in `shapes` (APART, N - 1) between `first` and `last`
    (K,), is in `step` (N - 1,), from which those of late ones are taken. True if any has changed."""
    changed = False
    for k in range(len(first)):
        d = shapes[k % APART]
        own, along = 0.0, 0.0
        for i in range(first[k], min(last[k], len(step))):
            own += d[i] * d[i]
            along += (step[i] + (d[i] if late[k] else 0.0)) * d[i]
        is_late = (
            own > 0.0
            and ONE[0] * own < along < ONE[1] * own
            and along * along > 2.0 * SURE * noise * own
        )
        if is_late != late[k]:
            for i in range(first[k], min(last[k], len(step))):
                step[i] += d[i] if late[k] else -d[i]
            late[k] = is_late
            changed = True
        untold[k] = not is_late and own < 2.0 * TOLD * noise
    return changed
