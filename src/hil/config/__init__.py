"""Settings of rigs and drives as validated values: what a file must say, with units and bounds.

Reading files is `hil.configfile`'s work; here is only what they mean.
"""

from hil.config.actuator import Actuator, DriveNode, LegMass, Screw
from hil.config.bicycle import BicycleFile
from hil.config.bus import Bus, Can, Imu, ImuMount, Noise, bus_of
from hil.config.control import (
    Control,
    CueLimits,
    Mode,
    Parking,
    PlatformFilterSettings,
    Safety,
)
from hil.config.geometry import AxisGeometry, MotorcycleGeometry, StewartGeometry
from hil.config.rig import Body, Effect, RigFile

AnyRig = RigFile | BicycleFile
"""A rig that is driven, or a bicycle, which is ridden."""

__all__ = [
    "Actuator",
    "AnyRig",
    "AxisGeometry",
    "BicycleFile",
    "Body",
    "Bus",
    "Can",
    "Control",
    "CueLimits",
    "DriveNode",
    "Effect",
    "Imu",
    "ImuMount",
    "LegMass",
    "Mode",
    "MotorcycleGeometry",
    "Noise",
    "Parking",
    "PlatformFilterSettings",
    "RigFile",
    "Safety",
    "Screw",
    "StewartGeometry",
    "bus_of",
]
