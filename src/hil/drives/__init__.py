"""What is said to servo controllers, and heard from them: codecs and state machines, pure.

`build_drivers` makes a rig's drivers; `driver` says what each of them offers, whatever it speaks.
"""

from hil.drives.build import build_drivers
from hil.drives.driver import DriveBus, DriveDriver, DrivePhase, DriveStatus, PowerGoal

__all__ = [
    "DriveBus",
    "DriveDriver",
    "DrivePhase",
    "DriveStatus",
    "PowerGoal",
    "build_drivers",
]
