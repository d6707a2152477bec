"""Frames of a whole rig in words, whichever families its drives are of."""

from __future__ import annotations

from typing import Protocol

from hil.config import RigFile
from hil.drives.build import parts_of
from hil.drives.cia402.describe import CanopenDescriber
from hil.drives.describe import Described, Describer
from hil.drives.profile import LustProfile
from hil.drives.profiles import Profiles
from hil.frames import Frame


class _Reader(Protocol):
    def describe(self, frame: Frame) -> Described: ...


class RigDescriber:
    """Asks each family's reader in turn. Addresses are unique in a rig, so the bus need not be known."""

    def __init__(self, rig: RigFile, profiles: Profiles) -> None:
        self._readers: list[_Reader] = []
        for _, actuators, part in parts_of(rig, profiles):
            profile = profiles[rig.actuators[actuators[0]].drive.profile]
            if isinstance(profile, LustProfile):
                self._readers.append(Describer(part, profile))
            else:
                self._readers.append(CanopenDescriber(part, profiles))

    def describe(self, frame: Frame) -> Described:
        """What `frame` says; never raises."""
        said = self._readers[0].describe(frame)
        for reader in self._readers[1:]:
            if said.name != "unknown":
                break
            said = reader.describe(frame)
        return said
