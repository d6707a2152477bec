"""What a rig file and a drive file become for one drive at the desk: alone on its bus, and with patience."""

from __future__ import annotations

import math
from typing import Final

from hil.config import RigFile
from hil.drives.profile import LustProfile
from hil.drives.profiles import DriveProfile
from hil.errors import ConfigError

SLOWEST_CYCLE_S: Final = 0.01
"""Nobody's motion is controlled here: a calm cycle will do on any computer."""
CALM_S: Final = 0.5
"""A command line has no real-time rights: drive and we bear with each other for so long."""
FAR: Final = 1e9


def alone(rig: RigFile, actuator: str) -> tuple[RigFile, int]:
    """The rig file with one actuator on one bus, driven by positions, and the bus it was on.

    ConfigError where there is no such actuator.
    """
    if actuator not in rig.actuator_names:
        raise ConfigError(
            f"{rig.name} has no actuator {actuator!r}, only {', '.join(rig.actuator_names)}"
        )
    i = rig.actuator_names.index(actuator)
    whole = rig.actuators[i]
    drive = whole.drive.model_copy(update={"address": rig.address(i), "bus": 0})
    cycle_s = max(rig.bus.cycle, SLOWEST_CYCLE_S)
    can = rig.can.model_copy(
        update={
            "url": rig.can.urls[whole.drive.bus],
            "bitrate": rig.can.bitrates[whole.drive.bus],
            "further": (),
        }
    )
    update = {
        "actuators": (whole.model_copy(update={"drive": drive}),),
        "imu": None,
        "can": can,
        "bus": rig.bus.model_copy(update={"cycle": cycle_s}),
        "control": rig.control.model_copy(update={"mode": "drive"}),
        "safety": rig.safety.model_copy(
            update={"drive_watchdog": CALM_S, "answer_timeout": CALM_S}
        ),
    }
    return rig.model_copy(update=update), whole.drive.bus


def calm(profile: DriveProfile) -> DriveProfile:
    """The drive file with as much patience for the drive's heartbeat as CALM_S."""
    if isinstance(profile, LustProfile):
        return profile
    watch = profile.supervision
    missed = max(watch.heartbeats_missed, math.ceil(CALM_S / watch.heartbeat))
    return profile.model_copy(
        update={"supervision": watch.model_copy(update={"heartbeats_missed": missed})}
    )


def unbounded(rig: RigFile) -> RigFile:
    """The rig file for a drive that does not know its zero: what it says of its position means nothing.

    In homing mode it heeds no target either; what holds it back are its own limits and speeds.
    """
    anywhere: dict[str, object] = {
        "stroke": (-FAR, FAR),
        "velocity_max": FAR,
        "acceleration_max": FAR,
    }
    return rig.model_copy(
        update={
            "actuators": tuple(a.model_copy(update=anywhere) for a in rig.actuators),
            "safety": rig.safety.model_copy(update={"following_error": FAR}),
        }
    )
