"""Friction of the actuators as the rig file gives it: viscous plus Coulomb, smooth through zero."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from hil.config import RigFile

SMOOTH_M_S: Final = 0.003
"""Coulomb friction rises over this speed: compensation must not hammer at standstill."""


class Friction:
    """Friction force of every actuator against its motion."""

    def __init__(self, rig: RigFile) -> None:
        self._viscous = np.array([a.viscous for a in rig.actuators])
        self._coulomb = np.array([a.coulomb for a in rig.actuators])

    def force(self, velocity: NDArray[np.float64]) -> NDArray[np.float64]:
        """Force (n,) that keeps the actuators moving at `velocity` (n,) against friction, N or N·m."""
        smooth: NDArray[np.float64] = np.tanh(velocity / SMOOTH_M_S)
        return self._viscous * velocity + self._coulomb * smooth
