"""Drivers for the drives that a rig file names."""

from __future__ import annotations

from hil.config import RigFile
from hil.drives.cia402.bus import CanopenBus
from hil.drives.driver import DriveBus
from hil.drives.lust_cdd3000.bus import LustBus
from hil.drives.lust_cdd3000.codec import INT32_MAX
from hil.drives.profile import GROUP, LustProfile
from hil.drives.profiles import DriveProfile, Profiles
from hil.drives.together import DrivesTogether, Part
from hil.errors import ConfigError


def build_drivers(rig: RigFile, profiles: Profiles) -> DriveBus:
    """The drivers of a rig, in the order of its actuators; `profiles` by the name the rig file uses.

    ConfigError where rig file and drive file contradict each other.
    """
    found = parts_of(rig, profiles)
    _check_schedule(rig, profiles)
    _check_counts(rig)
    parts = [Part(bus, _family(part, profiles), actuators) for bus, actuators, part in found]
    kinds = {driver.setpoint_kind for part in parts for driver in part.drives}
    if len(kinds) > 1:
        raise ConfigError(
            f'{rig.name}: control.mode = "{rig.control.mode}" sends forces, which not all of its drives take '
            '(layout.torque_reference = false); use mode "drive"'
        )
    if len(parts) == 1 and parts[0].bus == 0:
        _check_imu(rig, parts[0].drives)
        return parts[0].drives
    imu_ids = (rig.can.imu_base_id, rig.can.imu_base_id + 1) if rig.imu else ()
    return DrivesTogether(rig.name, parts, imu_ids)


def parts_of(rig: RigFile, profiles: Profiles) -> list[tuple[int, tuple[int, ...], RigFile]]:
    """Bus, actuators (by their places) and rig file of each family's drives on each bus.

    ConfigError where a drive file is missing.
    """
    groups: dict[tuple[int, str], list[int]] = {}
    for i, actuator in enumerate(rig.actuators):
        profile = _profile(rig, profiles, actuator.drive.profile)
        family = "canopen" if profile.protocol == "canopen" else actuator.drive.profile
        groups.setdefault((actuator.drive.bus, family), []).append(i)
    return [
        (bus, tuple(actuators), _part_of(rig, actuators))
        for (bus, _), actuators in sorted(groups.items())
    ]


def _part_of(rig: RigFile, actuators: list[int]) -> RigFile:
    """The rig file with only these actuators, each at the address that it has in the whole."""
    if len(actuators) == len(rig.actuators):
        return rig
    chosen = tuple(
        rig.actuators[i].model_copy(
            update={"drive": rig.actuators[i].drive.model_copy(update={"address": rig.address(i)})}
        )
        for i in actuators
    )
    return rig.model_copy(update={"actuators": chosen})


def _profile(rig: RigFile, profiles: Profiles, name: str) -> DriveProfile:
    if name not in profiles:
        raise ConfigError(f"{rig.name}: no drive file for actuators.drive.profile = {name!r}")
    return profiles[name]


def _family(rig: RigFile, profiles: Profiles) -> DriveBus:
    profile = profiles[rig.actuators[0].drive.profile]
    if isinstance(profile, LustProfile):
        _check(rig, profile)
        return LustBus(rig, profile)
    return CanopenBus(rig, profiles)


def _check_schedule(rig: RigFile, profiles: Profiles) -> None:
    """One schedule for the whole rig: where one drive answers parameters in slots, all go by slots."""
    asked = [
        name
        for name in sorted({a.drive.profile for a in rig.actuators})
        if isinstance(profiles[name], LustProfile)
    ]
    if asked and rig.bus.schedule != "parameter":
        raise ConfigError(
            f"{rig.name}: bus.schedule = {rig.bus.schedule!r}, but {asked[0]} answers one parameter "
            'in a slot; set "parameter"'
        )


def _check_counts(rig: RigFile) -> None:
    """Positions travel as 32 bits with sign, whatever the family: beyond that they would stand or wrap."""
    for actuator in rig.actuators:
        counts = max(map(abs, actuator.stroke)) * actuator.drive.counts_per_unit
        if counts > INT32_MAX:
            raise ConfigError(
                f"{rig.name}: {actuator.name} has {counts:.3g} increments at the end of its stroke; at most "
                f"{INT32_MAX} fit: correct its stroke or actuators.drive.counts_per_unit"
            )


def _check_imu(rig: RigFile, drives: DriveBus) -> None:
    if rig.imu is None:
        return
    DrivesTogether(
        rig.name,
        [Part(0, drives, tuple(range(len(drives))))],
        (rig.can.imu_base_id, rig.can.imu_base_id + 1),
    )


def _check(rig: RigFile, profile: LustProfile) -> None:
    layout, stride = profile.layout, profile.ids.stride
    if rig.control.mode == "cascade" and not layout.torque_reference:
        raise ConfigError(
            f'{rig.name}: control.mode = "cascade" sends forces, which {profile.name} does not take '
            '(layout.torque_reference = false); use mode "drive", or "computed_torque", whose forces '
            "then lead the position setpoints"
        )
    if "position" not in rig.bus.pattern and not layout.status_carries_position:
        raise ConfigError(f'{rig.name}: bus.pattern must ask for "position" at least once')
    if profile.timing.answer_wait >= rig.bus.cycle:
        raise ConfigError(
            f"{rig.name}: bus.cycle {rig.bus.cycle} s is not longer than timing.answer_wait "
            f"{profile.timing.answer_wait} s of {profile.name}: slots would go unused"
        )
    for i, actuator in enumerate(rig.actuators):
        if stride * rig.address(i) >= GROUP:
            raise ConfigError(
                f"{rig.name}: {actuator.name} has address {rig.address(i)}, at stride {stride} the "
                f"largest is {(GROUP - 1) // stride}"
            )
