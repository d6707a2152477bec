"""Everything that can be wrong with a rig on this PC, each part asked in turn."""

from __future__ import annotations

from pathlib import Path

from hil.bus.schedule import require_schedule_fits
from hil.config import RigFile
from hil.config.sizes import odd_sizes
from hil.daemon.check.bus import check_bus
from hil.daemon.check.drives import check_drives
from hil.daemon.check.finding import Finding, Probe
from hil.daemon.check.host import check_daemon, check_disk, check_endpoints, check_model
from hil.daemon.check.pc import check_cycle, check_pc
from hil.drives import build_drivers
from hil.drives.profiles import Profiles
from hil.errors import ConfigError


def check_rig(
    rig: RigFile, profiles: Profiles, probe: Probe, root: Path = Path("/")
) -> list[Finding]:
    """Everything about `rig` on this PC, whose files are below `root`. Opens the bus, and takes its time."""
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
        remedy = "correct the rig file: it is in m and rad"
        found += [Finding("warn", "rig file", f"{rig.name}: {s}", remedy) for s in odd_sizes(rig)]
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
