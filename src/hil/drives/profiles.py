"""What a drive file can be: one type for each family that hil speaks to."""

from __future__ import annotations

from collections.abc import Mapping

from hil.drives.cia402.profile import Cia402Profile
from hil.drives.profile import LustProfile

DriveProfile = LustProfile | Cia402Profile
Profiles = Mapping[str, DriveProfile]
"""Drive files by the names that rig files use."""
