"""The motion asked for at one instant, between shaping and the control modes."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray


class Reference(NamedTuple):
    """Pose, velocity, acceleration (n,) wanted at `t_s`, in the rig's coordinates (m or rad, s).

    `limited` names the rules that held this cycle's motion back.
    """

    t_s: float
    pose: NDArray[np.float64]
    velocity: NDArray[np.float64]
    acceleration: NDArray[np.float64]
    limited: tuple[str, ...] = ()

    def at(self, t_s: float) -> Reference:
        """This motion carried on, or back, to `t_s` with its acceleration; meant for a cycle or two."""
        tau = t_s - self.t_s
        return Reference(
            t_s,
            self.pose + tau * (self.velocity + 0.5 * tau * self.acceleration),
            self.velocity + tau * self.acceleration,
            self.acceleration,
            self.limited,
        )
