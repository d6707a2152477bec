"""What a motion of the platform asks of each actuator, against stroke, speed and acceleration limits."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hil.config import RigFile
from hil.errors import KinematicsError
from hil.rigs import Manipulator

Vector = NDArray[np.float64]

SPEED_SHARE: Final = 0.95
"""Share of velocity_max that setpoints may use: the rest is the drive's room to catch up."""


class Demand(NamedTuple):
    """Worst use of a limit (1 = all of it) and the rule it belongs to, as rule:actuator. Never NaN."""

    use: float
    rule: str


class ActuatorLimits:
    """Checks states of the platform against the limits of the rig file's actuators."""

    def __init__(self, rig: RigFile, manipulator: Manipulator) -> None:
        self._manipulator = manipulator
        self._names = rig.actuator_names
        margin = rig.safety.stroke_margin
        self._low = np.array([a.stroke[0] + margin for a in rig.actuators])
        self._high = np.array([a.stroke[1] - margin for a in rig.actuators])
        self._speed = SPEED_SHARE * np.array([a.velocity_max for a in rig.actuators])
        self._acceleration = np.array([a.acceleration_max for a in rig.actuators])

    def acceleration_share(self, limits: tuple[float, ...], acceleration: Vector) -> float:
        """Share of the coordinates' `acceleration` (n,) that no actuator minds anywhere in ± limits.

        Reckoned for all coordinates at once and the worst signs, at neutral and all corners.
        """
        n = len(limits)
        signs = np.array(np.meshgrid(*[[-1.0, 1.0]] * n)).reshape(n, -1).T
        share = 1.0
        for q in [np.zeros(n), *(signs * np.asarray(limits))]:
            try:
                demand = np.abs(self._manipulator.jacobian(q)) @ acceleration
            except KinematicsError:
                continue
            share = min(share, float(np.min(self._acceleration / demand)))
        return share

    def outside(self, q: Vector) -> float:
        """How far the worst actuator stands outside its stroke less margin at pose q, m or rad."""
        rho = self._manipulator.inverse(q)
        return float(max(np.max(self._low - rho), np.max(rho - self._high), 0.0))

    def demand(self, q: Vector, qd: Vector, qdd: Vector, faster: Vector | None = None) -> Demand:
        """The limit most used by this state; `faster` (n,) is how much |qd| may still grow."""
        m = self._manipulator
        try:
            J = m.jacobian(q)
            speed = np.abs(J @ qd) + (0.0 if faster is None else np.abs(J) @ faster)
            acceleration = np.abs(m.accelerations(q, qd, qdd))
        except KinematicsError:
            return Demand(2.0, "closure:rig")
        speed = np.nan_to_num(speed / self._speed, nan=np.inf)
        acceleration = np.nan_to_num(acceleration / self._acceleration, nan=np.inf)
        i, k = int(np.argmax(speed)), int(np.argmax(acceleration))
        if speed[i] >= acceleration[k]:
            return Demand(float(speed[i]), f"actuator_speed:{self._names[i]}")
        return Demand(float(acceleration[k]), f"actuator_acceleration:{self._names[k]}")

    def stroke_demand(self, q: Vector, allowed_outside: float = 0.0) -> Demand:
        """Use 0, or 2 where an actuator is outside its stroke less margin by more than allowed."""
        try:
            rho = self._manipulator.inverse(q)
        except KinematicsError:
            return Demand(2.0, "closure:rig")
        outside = np.maximum(self._low - rho, rho - self._high)
        i = int(np.argmax(outside))
        kept = outside[i] <= allowed_outside + 1.0e-9
        return Demand(0.0 if kept else 2.0, f"stroke:{self._names[i]}")
