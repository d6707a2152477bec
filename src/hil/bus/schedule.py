"""What a rig's own traffic asks of its bus, from the rig file."""

from __future__ import annotations

from hil.bus.load import ScheduledFrame, require_fits
from hil.config import RigFile


def rig_schedule(rig: RigFile) -> list[ScheduledFrame]:
    """The frames of every cycle with the parameter schedule: four a drive, all of 8 bytes, and the IMU's two.

    Empty where the rig file has another schedule: no bus carries such a rig.
    """
    if rig.bus.schedule != "parameter":
        return []
    frames = [
        ScheduledFrame(f"{name}'s {what} frame", 8, rig.bus.cycle)
        for name in rig.actuator_names
        for what in ("control", "status", "parameter request", "parameter answer")
    ]
    if rig.imu is not None:
        period_s = 1.0 / rig.imu.rate
        frames += [
            ScheduledFrame(f"the IMU's {what} frame", 8, period_s) for what in ("gyro", "accel")
        ]
    return frames


def require_schedule_fits(rig: RigFile) -> float:
    """The share of the bus that a rig needs at worst; ConfigError where that is too much."""
    return require_fits(rig_schedule(rig), rig.can.bitrate)
