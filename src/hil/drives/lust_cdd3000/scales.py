"""Increments of a drive to SI values at the actuator's output, and back."""

from __future__ import annotations

from hil.config import DriveNode, RigFile
from hil.drives.lust_cdd3000.codec import clamp_int32, from_wire, to_wire
from hil.drives.meaning import SetpointKind
from hil.drives.profile import LustProfile
from hil.signals import Quantity


def kind_of(rig: RigFile, profile: LustProfile) -> SetpointKind:
    """What is sent: force in the modes that reckon forces, where the firmware takes any; else position.

    Without a torque reference computed torque sends positions that lead by its speeds and forces.
    """
    takes_force = profile.layout.torque_reference
    return "force" if rig.control.mode != "drive" and takes_force else "position"


class Scales:
    """Scales of one drive: the rig file's for what its owner has calibrated, else the drive file's."""

    def __init__(self, node: DriveNode, profile: LustProfile) -> None:
        m = profile.parameters.measurements
        self.parameters = {
            "position": m.position,
            "velocity": m.velocity,
            "force": m.force,
            "current": m.current,
        }
        self._units = {
            "position": 1.0 / node.counts_per_unit,
            "velocity": 1.0,
            "force": node.force_per_count,
            "current": node.current_per_count,
        }

    def measured(self, quantity: Quantity, raw: int) -> float:
        """SI value of an answer; NaN or infinite only where a float32 on the wire is."""
        parameter = self.parameters[quantity]
        return from_wire(parameter.type, raw) * parameter.scale * self._units[quantity]

    def answer(self, quantity: Quantity, value: float) -> int:
        """What a drive answers for a finite SI value: the inverse of `measured`, saturating."""
        parameter = self.parameters[quantity]
        return to_wire(parameter.type, value / (parameter.scale * self._units[quantity]))

    def setpoint(self, kind: SetpointKind, increments: int) -> float:
        """SI value of a reference or, with kind "position", of a status frame's actual value."""
        return increments * self._units[kind]

    def reference(self, kind: SetpointKind, value: float) -> int:
        """Increments of a finite setpoint: the inverse of `setpoint`, saturating at int32's ends."""
        return clamp_int32(value / self._units[kind])
