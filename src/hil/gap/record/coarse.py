"""A twin with longer ticks, for what candidates do: differences of answers, of which two digits are plenty.

A drive's speed loop runs far faster than anything of the rig moves. What a change of a parameter does to the
answers is within a tenth the same where the loop runs at half its rate, and costs half as much. What a
record is held against, and every fit, is never answered so. Nor is what stands beside transmissions that
give or have play, where the loop holds a motor alone, light and fast; nor what is late by less than a tick.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from hil.config import RigFile
from hil.sim.parameters import ParameterTable

Array = NDArray[np.float64]

LONGEST_S: Final = 5e-4
"""Of a tick of a speed loop."""
FIRM: Final = 0.25
"""Of a speed that is off, at most, that a speed loop makes good in one tick: beyond it ticks show."""


def coarser(rig: RigFile) -> RigFile | None:
    """`rig` with longer ticks of its speed loops; None where those it has are as long as they may be."""
    bus = rig.bus
    per_tick = [a.speed_gain / a.effective_mass for a in rig.actuators if a.effective_mass > 0.0]
    longest_s = min(LONGEST_S, FIRM / max(per_tick, default=np.inf))
    ticks = round(bus.position_loop / bus.speed_loop)
    lengths = [
        m
        for m in range(1, ticks + 1)
        if ticks % m == 0 and m * bus.speed_loop < longest_s * (1 + 1e-9)
    ]
    if not lengths or lengths[-1] == 1:
        return None
    slower = bus.model_copy(update={"speed_loop": lengths[-1] * bus.speed_loop})
    return rig.model_copy(update={"bus": slower})


def tells(table: ParameterTable, vectors: Array, vector: Array) -> NDArray[np.bool_]:
    """(B,) of which of `vectors` (B, P of `table`) longer ticks tell the difference from `vector` (P,): no
    transmission gives or has play, and no clock and no sensor is later, which is less than such a tick."""
    names = [p.name for p in table.entries]
    loose = np.array([n.endswith((".compliance.stiffness", ".backlash.gap")) for n in names])
    late = np.array([n.endswith((".sensor_latency.delay", ".clock_drift.rate")) for n in names])
    rigid = (vectors == table.neutral)[:, loose].all(axis=1)
    rigid &= bool(np.all((vector == table.neutral)[loose]))
    return np.asarray(rigid & (vectors == vector)[:, late].all(axis=1))
