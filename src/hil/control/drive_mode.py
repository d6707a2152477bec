"""Mode "drive": position setpoints by inverse kinematics for the drives' own cascades."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray

from hil.config import RigFile
from hil.control.friction import Friction
from hil.control.observer import Observed
from hil.control.reference import Reference
from hil.control.setpoints import Setpoints, setpoint_leads
from hil.rigs import Manipulator

Vector = NDArray[np.float64]

COLUMNS = (
    *("position_gain", "speed_gain", "integral_gain", "velocity_ff"),
    *("acceleration_ff", "friction_ff", "static_ff", "effective_mass"),
)


class DriveMode:
    """Each drive gets the position its own setpoint line shall reach, at the instant it reaches it.

    With `feedforward="setpoint"` the setpoint leads by what makes the drive's P/PI cascade produce the
    reference's speed and force (for firmware that takes no torque reference): v/k_p for the speed, and
    for a force F the speed error e that its PI loop turns into F, k_v e + k_i ∫e = F, hence
    e = F/k_v · s/(s + k_i/k_v). A plain F/k_v would make the integrator pay the force twice and leave
    a lasting position error. What the drive feeds forward by itself is left out.
    """

    def __init__(
        self,
        rig: RigFile,
        manipulator: Manipulator,
        feedforward: Literal["none", "setpoint"] = "none",
    ) -> None:
        self._manipulator = manipulator
        self._friction = Friction(rig)
        self._late_s = setpoint_leads(rig)
        self._cycle_s = rig.bus.cycle
        self._lead = feedforward == "setpoint" and not rig.control.precontrol
        self._pd = np.array([a.law == "pd" for a in rig.actuators])
        column = {
            name: np.array([float(getattr(a, name)) for a in rig.actuators]) for name in COLUMNS
        }
        self._column = column
        feeds_static = [a.law != "cascade" for a in rig.actuators]
        self._static_ff = np.where(feeds_static, column["static_ff"], 0.0)
        speed_gain = np.maximum(column["speed_gain"], 1.0)
        self._speed_gain = speed_gain
        self._forget = np.exp(-rig.bus.cycle * column["integral_gain"] / speed_gain)
        self._force: Vector | None = None
        self._passed = np.zeros(manipulator.n)

    def reset(self, observed: Observed) -> None:
        """Start anew: the lead begins at zero."""
        self._force = None
        self._passed = np.zeros_like(observed.position)

    def step(self, now_s: float, reference: Reference, observed: Observed) -> Setpoints:
        """Position setpoints for the cycle that starts at `now_s`."""
        m, r = self._manipulator, reference
        rho, speed, acceleration = m.motion(r.pose, r.velocity, r.acceleration)
        late = self._late_s + (now_s + self._cycle_s - r.t_s)
        value = rho + late * (speed + 0.5 * late * acceleration)
        if self._lead:
            value = value + self._leading(r, speed, acceleration)
        return Setpoints(value, "position")

    def _leading(self, r: Reference, speed: Vector, acceleration: Vector) -> Vector:
        m, c = self._manipulator, self._column
        force = m.inverse_dynamics(r.pose, r.velocity, r.acceleration)
        still = np.zeros_like(speed)
        fed = self._static_ff * m.inverse_dynamics(r.pose, still, still)
        fed += np.where(self._pd, 0.0, c["acceleration_ff"] * c["effective_mass"] * acceleration)
        force = force - fed + (1.0 - c["friction_ff"]) * self._friction.force(speed)
        before = force if self._force is None else self._force
        self._passed = self._forget * (self._passed + force - before)
        self._force = force
        cascade = (1.0 - c["velocity_ff"]) * speed + self._passed / self._speed_gain
        pd = force + (1.0 - c["velocity_ff"]) * c["speed_gain"] * speed
        lead: Vector = np.where(self._pd, pd, cascade) / c["position_gain"]
        return lead
