"""Drivers for the drives that a rig file names."""

from __future__ import annotations

from collections.abc import Mapping

from hil.config import RigFile
from hil.drives.driver import DriveBus
from hil.drives.lust_cdd3000.bus import LustBus
from hil.drives.profile import GROUP, LustProfile
from hil.errors import ConfigError


def build_drivers(rig: RigFile, profiles: Mapping[str, LustProfile]) -> DriveBus:
    """The drivers of a rig, in the order of its actuators; `profiles` by the name the rig file uses.

    ConfigError where rig file and drive file contradict each other.
    """
    names = {a.drive.profile for a in rig.actuators}
    if len(names) > 1:
        raise ConfigError(f"{rig.name}: one bus carries one drive family, not {sorted(names)}")
    (name,) = names
    if name not in profiles:
        raise ConfigError(f"{rig.name}: no drive file for actuators.drive.profile = {name!r}")
    profile = profiles[name]
    _check(rig, profile)
    return LustBus(rig, profile)


def _check(rig: RigFile, profile: LustProfile) -> None:
    if rig.bus.schedule != "parameter":
        raise ConfigError(
            f"{rig.name}: bus.schedule = {rig.bus.schedule!r}, but {profile.name} answers one parameter "
            'in a slot; set "parameter"'
        )
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
