"""Mode "computed_torque": the model makes every coordinate a double integrator, poles placed on it.

Seed 0's eq. (37) in projected form: F = (J A)^-T [Aᵀ M A (q̈_d + K_d ė + K_p e) + h], so that
ë + K_d ė + K_p e = 0 (39) [V]. Friction of the rig file is added, and what the observer finds
unexplained is taken away, which is the integral action.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hil.config import RigFile
from hil.control.friction import Friction
from hil.control.observer import Observed
from hil.control.placement import second_order_gains
from hil.control.reference import Reference
from hil.control.setpoints import Setpoints, slot_offsets, within
from hil.rigs import Manipulator

Vector = NDArray[np.float64]


class ComputedTorque:
    """Force setpoints from the rig's model; both states taken at the middle of the force's life."""

    def __init__(self, rig: RigFile, manipulator: Manipulator) -> None:
        self._manipulator = manipulator
        self._friction = Friction(rig)
        self._k_p, self._k_d = second_order_gains(rig.control.bandwidth, rig.control.damping)
        self._delay_s = float(np.mean(slot_offsets(rig)))
        self._half_s = 0.5 * rig.bus.cycle
        self._limit_n = np.array([a.force_max for a in rig.actuators])

    def reset(self, observed: Observed) -> None:
        """Nothing to reset: the law has no memory, its integral action lives in the observer."""

    def step(self, now_s: float, reference: Reference, observed: Observed) -> Setpoints:
        """Force setpoints for the cycle that starts at `now_s`."""
        m = self._manipulator
        wanted = reference.at(now_s + self._delay_s + self._half_s)
        # Until the force arrives the last one acts, afterwards the motion is as wanted.
        q, qd = _coast(observed.pose, observed.rates, observed.pose_acceleration, self._delay_s)
        q, qd = _coast(q, qd, wanted.acceleration, self._half_s)
        command = (
            wanted.acceleration
            + self._k_d * (wanted.velocity - qd)
            + self._k_p * (wanted.pose - q)
            - observed.unexplained
        )
        force = m.inverse_dynamics(q, qd, command)
        # Friction by the speed wanted: by the speed observed, its noise would rattle at standstill.
        force = force + self._friction.force(m.rates(wanted.pose, wanted.velocity))
        return Setpoints(within(force, self._limit_n), "force")


def _coast(q: Vector, qd: Vector, qdd: Vector, dt_s: float) -> tuple[Vector, Vector]:
    return q + dt_s * (qd + 0.5 * dt_s * qdd), qd + dt_s * qdd
