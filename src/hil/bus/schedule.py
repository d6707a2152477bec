"""What a rig's own traffic asks of each of its buses, from rig file and drive files."""

from __future__ import annotations

from math import ceil
from typing import Final

from hil.bus.load import SHARE_LIMIT, ScheduledFrame, require_fits, share
from hil.config import RigFile
from hil.drives.cia402.bus import HEARTBEATS
from hil.drives.cia402.mapping import TPDO, candidates, rpdo
from hil.drives.cia402.profile import Cia402Profile
from hil.drives.profiles import Profiles
from hil.errors import ConfigError

ROUND_S: Final = 0.0005
"""Cycles that are proposed are multiples of this."""


def bus_schedules(rig: RigFile, profiles: Profiles) -> list[list[ScheduledFrame]]:
    """The cyclic frames of each bus, in the order in which the rig file counts its buses.

    CANLust: four a drive and cycle, all of 8 bytes. CiA 402: SYNC, two PDOs a drive and cycle, heartbeats.
    The IMU's two are on the first bus.
    """
    return [_of_bus(rig, profiles, bus) for bus in range(len(rig.can.urls))]


def require_schedule_fits(rig: RigFile, profiles: Profiles) -> float:
    """The largest share of a bus that a rig needs at worst; ConfigError, with what fits, where too much."""
    shares = [0.0]
    for bus, schedule in enumerate(bus_schedules(rig, profiles)):
        bitrate_bps = rig.can.bitrates[bus]
        try:
            shares.append(require_fits(schedule, bitrate_bps))
        except ConfigError as error:
            raise ConfigError(
                f"{rig.name}, bus {bus}: {error}. {_what_fits(rig, profiles, bus)}"
            ) from None
    return max(shares)


def _of_bus(rig: RigFile, profiles: Profiles, bus: int) -> list[ScheduledFrame]:
    frames: list[ScheduledFrame] = []
    cycle_s, is_canopen = rig.bus.cycle, False
    for actuator in rig.actuators:
        if actuator.drive.bus != bus:
            continue
        profile, name = profiles[actuator.drive.profile], actuator.name
        if isinstance(profile, Cia402Profile):
            is_canopen = True
            length = rpdo(candidates(rig, actuator)[0]).length
            frames += [
                ScheduledFrame(f"{name}'s setpoint PDO", length, cycle_s),
                ScheduledFrame(f"{name}'s answer PDO", TPDO.length, cycle_s),
                ScheduledFrame(f"{name}'s heartbeat", 1, profile.supervision.heartbeat),
            ]
        else:
            frames += [
                ScheduledFrame(f"{name}'s {what} frame", 8, cycle_s)
                for what in ("control", "status", "parameter request", "parameter answer")
            ]
    if is_canopen:
        frames += [
            ScheduledFrame("SYNC", 0, cycle_s),
            ScheduledFrame("our heartbeat", 1, rig.safety.drive_watchdog / HEARTBEATS),
        ]
    if rig.imu is not None and bus == 0:
        frames += [
            ScheduledFrame(f"the IMU's {what} frame", 8, 1.0 / rig.imu.rate)
            for what in ("gyro", "accel")
        ]
    return frames


def _what_fits(rig: RigFile, profiles: Profiles, bus: int) -> str:
    """How many of the bus's drives fit at this cycle, and at which cycle all of them do."""
    bitrate_bps = rig.can.bitrates[bus]
    drives = [a.name for a in rig.actuators if a.drive.bus == bus]
    frames = _of_bus(rig, profiles, bus)
    others = [f for f in frames if f.name.partition("'")[0] not in drives]
    count = 0
    for n in range(1, len(drives)):
        of_these = [f for f in frames if f.name.partition("'")[0] in drives[:n]]
        if share(others + of_these, bitrate_bps) <= SHARE_LIMIT:
            count = n
    cyclic = [f for f in frames if f.period_s == rig.bus.cycle]
    rest = SHARE_LIMIT - share([f for f in frames if f.period_s != rig.bus.cycle], bitrate_bps)
    longer_s = (
        ceil(share(cyclic, bitrate_bps) * rig.bus.cycle / max(rest, 0.01) / ROUND_S) * ROUND_S
    )
    return (
        f"What fits on a bus of {bitrate_bps / 1000:g} kbit/s: {count} of these {len(drives)} drives with "
        f"bus.cycle = {rig.bus.cycle:g} (put the others on a bus of their own: [[can.further]] and "
        f"actuators.drive.bus), or all of them with bus.cycle = {longer_s:g}"
    )
