"""Friction of the actuators as the rig file knows it, its effects included: smooth through zero.

What `hil gap apply` writes as an effect is friction that the rig has, so whoever feeds friction forward
counts it in. Of the Stribeck effect only the Coulomb part: what it adds near standstill would hammer
there; of viscous friction that differs between directions the mean. Hysteresis and friction that grows with
load hang on more than the speed and are left out.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hil.config import RigFile

Array = NDArray[np.float64]

SMOOTH_M_S: Final = 0.003
"""Coulomb friction rises over this speed: compensation must not hammer at standstill."""


OF_EFFECTS: Final[dict[str, dict[str, tuple[float, float, float]]]] = {
    "viscous_friction": {"coefficient": (1.0, 0.0, 0.0)},
    "asymmetric_viscous_friction": {"positive": (0.5, 0.0, 0.0), "negative": (0.5, 0.0, 0.0)},
    "coulomb_friction": {"force": (0.0, 1.0, 1.0)},
    "stribeck_friction": {"coulomb": (0.0, 1.0, 1.0)},
    "asymmetric_friction": {"positive": (0.0, 1.0, 0.0), "negative": (0.0, 0.0, 1.0)},
}
"""By effect and parameter, its share of viscous friction, and of Coulomb friction forwards and backwards."""


@dataclass(frozen=True, slots=True)
class KnownFriction:
    """Friction of n actuators, never below zero: N·s/m and N (rotary: N·m·s/rad and N·m)."""

    viscous: Array
    """(n,)."""
    positive: Array
    """(n,) Coulomb friction against motion in the positive direction."""
    negative: Array
    """(n,) and in the negative one."""


def known_friction(rig: RigFile) -> KnownFriction:
    """The rig file's own friction with that of its effects."""
    own = np.array([[a.viscous, a.coulomb, a.coulomb] for a in rig.actuators]).T
    for line in rig.effects:
        if line.location in rig.actuator_names:
            i = rig.actuator_names.index(line.location)
            for parameter, shares in OF_EFFECTS.get(line.effect, {}).items():
                own[:, i] += line.parameters.get(parameter, 0.0) * np.array(shares)
    return KnownFriction(*np.maximum(own, 0.0))


class Friction:
    """Friction force of every actuator against its motion."""

    def __init__(self, rig: RigFile) -> None:
        self._known = known_friction(rig)

    def force(self, velocity: Array) -> Array:
        """Force (n,) that keeps the actuators moving at `velocity` (n,) against friction, N or N·m."""
        smooth: Array = np.tanh(velocity / SMOOTH_M_S)
        coulomb = np.where(velocity > 0.0, self._known.positive, self._known.negative)
        return np.asarray(self._known.viscous * velocity + coulomb * smooth)
