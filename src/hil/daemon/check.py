"""What is wrong with this PC, its bus and its drives for a rig, and how to mend it.

Each part looks at one thing and returns findings; nothing here changes the PC, and the bus is only
listened to unless told otherwise.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from hil.bus.schedule import require_schedule_fits
from hil.config import RigFile
from hil.drives import build_drivers
from hil.drives.profiles import Profiles
from hil.errors import ConfigError

Level = Literal["ok", "warn", "fault"]


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing that was looked at. `fault`: the rig will not run; `warn`: it will run worse."""

    level: Level
    topic: str
    text: str
    remedy: str = ""
    """What to do, where something is wrong."""


@dataclass(frozen=True, slots=True)
class Probe:
    """How far the drives are asked."""

    listen_s: float = 0.6
    """How long the bus is listened to."""
    asks: bool = False
    """Read one parameter of each drive."""
    prepares: bool = False
    """Prepare the drives as for arming, power off."""


def check_rig(
    rig: RigFile, profiles: Profiles, probe: Probe, root: Path = Path("/")
) -> list[Finding]:
    """Everything about `rig` on this PC, whose files are below `root`. Opens the bus, and takes its time."""
    from hil.daemon.check_bus import check_bus
    from hil.daemon.check_drives import check_drives
    from hil.daemon.check_host import check_daemon, check_disk, check_endpoints, check_model
    from hil.daemon.check_pc import check_cycle, check_pc

    found = check_contradictions(rig, profiles)
    found += check_pc(root)
    found += check_cycle(rig)
    found += check_bus(rig, root)
    daemon = check_daemon(rig)
    found += [*daemon, *check_endpoints(rig, is_running=daemon[0].level != "ok"), *check_disk(rig)]
    if any(f.level == "fault" for f in found if f.topic in ("rig file", "bus")):
        return found
    found += check_model(rig, profiles)
    return found + check_drives(rig, profiles, probe)


def check_contradictions(rig: RigFile, profiles: Profiles) -> list[Finding]:
    """Whether rig file, drive file and bit rate fit together."""
    found = []
    try:
        build_drivers(rig, profiles)
        found.append(Finding("ok", "rig file", f"{rig.name}: a {rig.kind}, no fault found"))
    except ConfigError as error:
        found.append(Finding("fault", "rig file", str(error), "correct the rig file"))
    try:
        share = require_schedule_fits(rig, profiles)
        text = f"its schedule needs {share:.0%} of {rig.can.bitrate / 1000:g} kbit/s at worst"
        found.append(Finding("ok", "bus load", text))
    except ConfigError as error:
        text, _, fits = str(error).partition(". What fits ")
        remedy = f"what fits {fits}" if fits else "correct the rig file"
        found.append(Finding("fault", "bus load", text, remedy))
    return found
