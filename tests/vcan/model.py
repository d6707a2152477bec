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
from hil.daemon.simulated import SimulatedSession
from hil.drives.profile import LustProfile

RIGS = ("axis", "motorcycle")
"""Those that the guest's tests ride."""
PACKAGE = Path(hil.__file__).resolve().parent


def make() -> None:
    """Call all that a daemon and a simulated rig call: arm each rig in simulated time, then park it."""
    profiles = {"lust_cdd3000": load_drive("lust_cdd3000", LustProfile)}
    for name in RIGS:
        session = SimulatedSession(load_rig(name), profiles)
        session.arm()
        session.leave()


def hand_over(cache: Path) -> None:
    """Copy what stands beside the sources into the user's cache folder `cache` (an XDG_CACHE_HOME)."""
    for compiled in PACKAGE.rglob("__pycache__/*.nb[ic]"):
        source = compiled.parent.parent / "any.py"
        to = cache / "numba" / UserWideCacheLocator.get_suitable_cache_subpath(str(source))
        to.mkdir(parents=True, exist_ok=True)
        shutil.copy2(compiled, to)


if __name__ == "__main__":
    make()
    print(f"the model of these sources ({sources_stamp()[:8]}) is compiled")
