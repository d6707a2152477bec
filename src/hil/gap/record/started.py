"""When the clocks started by which drives play their setpoints: the first frame starts each, late as it came.

A drive that plays setpoints by its own clock hears no jitter, but all of a run is as late as its first frame
was. No stamp tells that, and a tenth of a millisecond is tens of micrometres at full speed: a hundred floors
of a fine encoder.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hil.bus.load import RECKONED_BITS
from hil.gap.record.apart import apart
from hil.gap.record.fineness import CLEARER
from hil.gap.record.problem import Problem
from hil.gap.record.ticks import Clocks, Ticks

Array = NDArray[np.float64]


def started(problem: Problem, vector: Array) -> Clocks:
    """How late each drive's own clock was started: by the wait of the first frame, for those of all drives at
    most and one. Which setpoint is played when jumps with it, so no slope leads there: all are tried, and the
    earliest is taken that no other is clearly better than.

    What is left of that from stretch to stretch shows in the positions.
    """
    rig = problem.rig
    names = rig.actuator_names
    frame_s = RECKONED_BITS / rig.can.bitrate
    tried = np.arange(0.0, (len(names) + 1) * frame_s + 1e-9, frame_s)
    keys = [(k, a) for k, p in enumerate(problem.pieces) if p.mode == "position" for a in names]
    sizes = {key: np.full(len(tried), np.inf) for key in keys}
    for d, late_s in enumerate(tried):
        clocks = {key: Ticks(0.0, 0.0, 0.0, float(late_s)) for key in keys}
        left = problem.with_clocks(clocks).residual(vector)
        for x in problem.series:
            if x.quantity == "force" and (x.stretch, x.actuator) in sizes:
                kept = problem.kept[x.part]
                middle = float(np.median(np.abs(left[x.part][kept]))) if kept.any() else np.inf
                sizes[x.stretch, x.actuator][d] = middle
    found = {}
    for key, size in sizes.items():
        if np.isfinite(size).all():
            as_good = np.log(size + 1e-300) < np.log(size.min() + 1e-300) + CLEARER
            found[key] = Ticks(0.0, 0.0, 0.0, float(tried[np.argmax(as_good)]))
    return apart(problem, found, vector, float(tried[-1]), min)
