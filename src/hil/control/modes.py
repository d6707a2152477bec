"""The control mode that a rig file asks for."""

from __future__ import annotations

from typing import Protocol

from hil.config import RigFile
from hil.control.cascade import Cascade
from hil.control.computed_torque import ComputedTorque
from hil.control.drive_mode import DriveMode
from hil.control.observer import Observed
from hil.control.reference import Reference
from hil.control.setpoints import Setpoints
from hil.control.stability import check_bandwidth
from hil.errors import ConfigError
from hil.rigs import Manipulator


class Controller(Protocol):
    """One control mode: setpoints each cycle, and a start without a jump."""

    def reset(self, observed: Observed) -> None:
        """Start from the present state."""
        ...

    def step(self, now_s: float, reference: Reference, observed: Observed) -> Setpoints:
        """Setpoints for the cycle that starts at `now_s`."""
        ...


def build_controller(
    rig: RigFile, manipulator: Manipulator, torque_reference: bool = True
) -> Controller:
    """The mode of control.mode; ConfigError where its bandwidth cannot be stable.

    Where the drives take no torque reference, "computed_torque" becomes position setpoints that lead
    by the model's speed and force, and "cascade" is refused: the drive's own cascade does that.
    """
    mode = rig.control.mode
    if mode == "drive":
        return DriveMode(rig, manipulator)
    if not torque_reference:
        if mode == "computed_torque":
            return DriveMode(rig, manipulator, feedforward="setpoint")
        raise ConfigError(
            f'{rig.name}: control.mode = "cascade" needs drives that take a torque reference; '
            'these do not: use "drive"'
        )
    check_bandwidth(rig, manipulator)
    return Cascade(rig, manipulator) if mode == "cascade" else ComputedTorque(rig, manipulator)
