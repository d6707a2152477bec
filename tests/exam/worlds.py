"""Short motions and rigs for tests of the exam's world."""

from __future__ import annotations

import numpy as np

from hil.config import RigFile
from hil.configfile import load_rig
from hil.control.trajectory import CueTrajectory


def sway(
    rig: RigFile, duration_s: float = 8.0, share: float = 0.3, hz: float = 0.3
) -> CueTrajectory:
    """Every coordinate on a sinusoid of its own that starts smoothly."""
    t = np.arange(0.0, duration_s, 0.005)
    fade = np.clip((t - 0.5) / 1.5, 0.0, 1.0)
    fade = fade**2 * (3.0 - 2.0 * fade)
    poses = np.column_stack(
        [
            share * limit * fade * np.sin(2.0 * np.pi * (hz + 0.07 * k) * (t - 0.5))
            for k, limit in enumerate(rig.limits)
        ]
    )
    return CueTrajectory(rig.coordinates, t, poses)


def smooth_axis(**actuator: object) -> RigFile:
    """The shipped axis without friction, its one actuator changed."""
    rig = load_rig("axis")
    changed = rig.actuators[0].model_copy(update={"coulomb": 0.0, "viscous": 0.0, **actuator})
    return rig.model_copy(update={"actuators": (changed,)})
