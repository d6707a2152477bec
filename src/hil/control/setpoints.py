"""What a control mode hands to the drives, and the timing with which it acts there."""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hil.config import RigFile

Kind = Literal["position", "force"]


class Setpoints(NamedTuple):
    """One value an actuator (n,): m or rad for "position", N or N·m for "force"."""

    values: NDArray[np.float64]
    kind: Kind


def within(values: NDArray[np.float64], limit: NDArray[np.float64]) -> NDArray[np.float64]:
    """`values` (n,) within ± `limit` (n,): np.clip at a quarter of its cost."""
    inside: NDArray[np.float64] = np.minimum(np.maximum(values, -limit), limit)
    return inside


def slot_offsets(rig: RigFile) -> NDArray[np.float64]:
    """Time from the start of a cycle to each drive's acting on its setpoint (n,), s.

    In the schedule "parameter" the drives' slots follow each other by bus.stagger; in "fast" all
    setpoints go out at once.
    """
    stagger = rig.bus.stagger if rig.bus.schedule == "parameter" else 0.0
    return np.array([rig.bus.setpoint_delay + stagger * i for i in range(len(rig.actuators))])


def setpoint_leads(rig: RigFile) -> NDArray[np.float64]:
    """Time from a reference's instant, one cycle ahead, to each drive's reaching its setpoint (n,), s.

    A straight line arrives one cycle after its start, later where the drive rests for a tick first, a held
    value is right half a cycle late (`Bus.reach_s`); a drive with its own clock plays setpoints later.
    """
    return slot_offsets(rig) + clock_waits(rig) + rig.bus.reach_s - rig.bus.cycle


def clock_waits(rig: RigFile) -> NDArray[np.float64]:
    """How long each drive's setpoint waits for that drive's own clock (n,), s."""
    return np.array([rig.bus.waits_s(i) for i in range(len(rig.actuators))])
