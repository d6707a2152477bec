"""A stretch packed for the twin; one whose setpoints are forces is led by the positions that were measured.

Forces alone say nothing of where a rig should be: some loop outside the drives held it there, the daemon's
computed torque or anybody's, and it is not the twin's. Without it a platform falls over and even an axis
drifts away with the smallest error of its mass. So the twin follows the measured positions on a soft
spring, as an observer does: what a force that it does not know does to the rig stays in the residual, at
frequencies above the spring's whole and below them as far as the spring gives way.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from hil.config import RigFile
from hil.identify.replay import Series, Stretch
from hil.sim.twin import Replay, Twin, lead_w

Array = NDArray[np.float64]


def replay_led(
    rig: RigFile,
    piece: Stretch,
    stamps: Mapping[str, Array],
    lead: Mapping[str, Series] | None = None,
) -> Replay:
    """`piece` packed for the twin, answering the signals of `stamps` at those instants.

    `lead`: by actuator, positions that lead it instead of the measured ones; in mode "position" nothing
    leads, the drives' own loops do.
    """
    twin = Twin(rig, smooth=True, payload=piece.payload)
    if piece.mode == "position":
        return twin.record(piece.setpoints, stamps, ticked=piece.ticked)
    measured = {
        a: piece.samples[f"{a}.position"]
        for a in rig.actuator_names
        if len(piece.samples.get(f"{a}.position", ((), ()))[0])
    }
    start = [float(measured[a.name][1][0]) if a.name in measured else a.home for a in rig.actuators]
    return twin.record(
        piece.setpoints, stamps, mode="force", start=start, lead={**measured, **(lead or {})}
    )


def lacking(t_s: Array, error: Array) -> Array:
    """(N,) acceleration that a led twin lacks whose positions are off by `error` (N,) at `t_s`: what would
    stretch its spring so."""
    w = lead_w(t_s)
    rate = np.gradient(error, t_s)
    return np.asarray(np.gradient(rate, t_s) + 2.0 * w * rate + w * w * error)
