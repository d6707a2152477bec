"""The compiled model for the guest: made on the host, which compiles several times faster, and handed over.

    python -m tests.vcan.model

makes it, beside the sources, where the guest's tests find it as they are. The service may not write there
and has a cache of its own, in numba's layout for a user; `hand_over` fills that. Numba itself looks whether
processor, versions and sources are those that the code was made for, and compiles anew where they are not.
"""

from __future__ import annotations

import shutil
from pathlib import Path

from numba.core.caching import UserWideCacheLocator

import hil
from hil.compiled import sources_stamp
from hil.configfile import load_drive, load_rig
from hil.control.demo_ride import DemoRide
from hil.control.streaming import cues
from hil.daemon.simulated import SimulatedSession, cue_at
from hil.drives.profile import LustProfile

RIGS = ("axis", "motorcycle")
"""Those that the guest's tests ride."""
PACKAGE = Path(hil.__file__).resolve().parent


def make() -> None:
    """Call all that a daemon and a simulated rig call: arm each rig in simulated time, ride, park."""
    profiles = {"lust_cdd3000": load_drive("lust_cdd3000", LustProfile)}
    for name in RIGS:
        rig = load_rig(name)
        session = SimulatedSession(rig, profiles)
        session.arm()
        start_s = session.now_s
        for cue in cues(DemoRide(rig).poses, 0.0, 1.0, "model"):
            session.cue(cue_at(cue, start_s))
        session.leave()


def hand_over(sources: Path, cache: Path) -> None:
    """Copy what stands beside the sources of hil into the user's cache folder `cache` (an XDG_CACHE_HOME).

    `sources` is where the user sees them.
    """
    for compiled in PACKAGE.rglob("__pycache__/*.nb[ic]"):
        source = sources / compiled.parent.parent.relative_to(PACKAGE) / "any.py"
        to = cache / "numba" / UserWideCacheLocator.get_suitable_cache_subpath(str(source))
        to.mkdir(parents=True, exist_ok=True)
        shutil.copy2(compiled, to)


if __name__ == "__main__":
    make()
    print(f"the model of these sources ({sources_stamp()[:8]}) is compiled")
