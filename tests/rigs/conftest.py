"""Rigs as the tests want them: with and without rotor and leg masses."""

from __future__ import annotations

import pytest

from hil.config.actuator import LegMass
from hil.config.rig import RigFile
from hil.configfile import load_rig
from tests.rigs.models import bare, with_legs


@pytest.fixture(scope="session")
def motorcycle_file() -> RigFile:
    return load_rig("motorcycle")


@pytest.fixture(scope="session")
def stewart_file() -> RigFile:
    return load_rig("stewart")


@pytest.fixture(scope="session", params=["vertical", "pendulum", "motorcycle", "stewart"])
def heavy_file(request: pytest.FixtureRequest) -> RigFile:
    """Each kind of rig with all the masses it can have: rotors, and legs where there are any."""
    if request.param == "pendulum":
        return pendulum()
    rig = bench("vertical") if request.param == "vertical" else load_rig(request.param)
    leg = LegMass(
        lower_mass=6.0, lower_cog=0.3, lower_inertia=0.4,
        upper_mass=4.0, upper_cog=0.25, upper_inertia=0.2,
    )  # fmt: skip
    return with_legs(rig, leg)


def bench(load: str, **mass: object) -> RigFile:
    """The axis bench with its load mounted this way."""
    axis = load_rig("axis").model_dump()
    axis["geometry"]["load"] = load
    axis["mass"].update(mass)
    return RigFile.model_validate(axis)


def pendulum() -> RigFile:
    """The axis bench with a load that hangs on a rotary drive."""
    rig = bench("pendulum", cog=(0.03, 0.02, -0.4))
    return bare(rig.model_copy(update={"limits": (1.2,)}), reflected=0.7)
