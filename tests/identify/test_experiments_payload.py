"""A payload bolted on the simulated rig: as heavy, and as hard to turn, as the body with it would be."""

from __future__ import annotations

import numpy as np
import pytest

from hil.configfile import load_rig
from hil.errors import ConfigError
from hil.identify.experiments.payload import bolted
from hil.runs.folder import Payload


@pytest.fixture(scope="module")
def rig():
    return load_rig("motorcycle")


def effects(rig, payload):
    return {e.effect: e.parameters for e in bolted(rig, payload)}


def test_at_the_centre_of_gravity_it_adds_mass_alone(rig):
    x, y, z = rig.mass.cog
    found = effects(rig, Payload(mass=30.0, x=x, y=y, z=z))
    assert found["payload_mass"] == {"mass": 30.0}
    assert list(found["payload_cog"].values()) == pytest.approx([0.0] * 3, abs=1e-12)
    assert list(found["payload_inertia"].values()) == pytest.approx([0.0] * 3, abs=1e-12)


@pytest.mark.parametrize("axis", range(3))
def test_beside_it_centre_and_inertia_are_those_of_both_bodies(rig, axis):
    m, cog, inertia = rig.mass.m, np.array(rig.mass.cog), np.array(rig.mass.inertia)
    place = cog + 0.3 * np.eye(3)[axis]
    found = effects(rig, Payload(mass=30.0, x=place[0], y=place[1], z=place[2]))
    # as two point clouds: the body as its mass in six points with its inertia, the payload as one
    arm = np.sqrt((0.5 * np.trace(inertia) - np.diag(inertia)) / m * 3.0)
    points = np.vstack([cog + s * arm[k] * np.eye(3)[k] for k in range(3) for s in (1, -1)])
    masses = np.full(6, m / 6.0)
    points, masses = np.vstack([points, place]), np.append(masses, 30.0)
    both = masses @ points / masses.sum()
    r = points - both
    total = np.array([np.sum(masses * (np.sum(r**2, axis=1) - r[:, k] ** 2)) for k in range(3)])
    assert list(found["payload_cog"].values()) == pytest.approx(both - cog, abs=1e-12)
    more = total - np.diag(inertia)
    assert list(found["payload_inertia"].values()) == pytest.approx(more, abs=1e-9)


def test_where_it_would_tilt_the_principal_axes_the_simulated_rig_refuses(rig):
    x, y, z = rig.mass.cog
    with pytest.raises(ConfigError, match="put it at the centre of gravity"):
        bolted(rig, Payload(mass=30.0, x=x + 0.3, y=y + 0.2, z=z))
