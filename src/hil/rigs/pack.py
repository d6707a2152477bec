"""A rig file as the flat arrays that the compiled kernels take; layouts in `hil.rigs.kernel`."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hil.config.geometry import AxisGeometry, MotorcycleGeometry, StewartGeometry
from hil.config.rig import RigFile
from hil.errors import ConfigError
from hil.rigs.kernel import AXIS, MOTORCYCLE, PENDULUM, STEWART

Array = NDArray[np.float64]

DIRECTION = {
    "horizontal": (1.0, 0.0, 0.0),
    "vertical": (0.0, 0.0, 1.0),
    "pendulum": (0.0, 1.0, 0.0),
}


def kind_code(rig: RigFile) -> int:
    """The kernel's kind of mechanism: AXIS, PENDULUM, MOTORCYCLE or STEWART."""
    if isinstance(rig.geometry, AxisGeometry):
        return PENDULUM if rig.geometry.load == "pendulum" else AXIS
    return MOTORCYCLE if isinstance(rig.geometry, MotorcycleGeometry) else STEWART


def pack_geometry(rig: RigFile) -> Array:
    """Joint coordinates, flat, m. ConfigError where a pendulum would not hang down at 0."""
    g = rig.geometry
    if isinstance(g, AxisGeometry):
        if g.load == "pendulum" and rig.mass.cog[2] >= 0.0:
            raise ConfigError(
                f"{rig.name}: mass.cog: a pendulum hangs down at position 0, so z must be below 0 "
                f"(got {rig.mass.cog[2]})"
            )
        return np.array(DIRECTION[g.load])
    if isinstance(g, StewartGeometry):
        legs = [(*b, *c) for b, c in zip(g.base, g.cabin, strict=True)]
        return np.array([x for leg in legs for x in leg] + [g.height], dtype=float)
    front = [0.0, 0.0, 0.0, 0.0, g.l, 0.0, 0.0, 0.0, 0.0, 0.0, -g.l, 0.0]
    return np.array([*front, -g.L, 0.0, g.h, -g.l3, 0.0, -g.h3])


def joint_index(rig: RigFile, joint: str) -> int:
    """Index of the x of `joint` ("leg3.platform", "slide.base") in the geometry; y, z follow."""
    actuator, _, end = joint.partition(".")
    if (
        kind_code(rig) in (AXIS, PENDULUM)
        or actuator not in rig.actuator_names
        or end not in ("base", "platform")
    ):
        raise ConfigError(
            f"{rig.name}: {joint!r} is no joint of this rig; joints are called ACTUATOR.base and "
            f"ACTUATOR.platform, actuators are {', '.join(rig.actuator_names)}"
        )
    return 6 * rig.actuator_names.index(actuator) + (3 if end == "platform" else 0)


def pack_body(rig: RigFile) -> Array:
    """[m, cx, cy, cz, Ixx, Iyy, Izz, Ixy, Ixz, Iyz], kg, m, kg·m² (elements of the tensor)."""
    inertia = rig.mass.inertia
    return np.array(
        [
            rig.mass.m,
            *rig.mass.cog,
            *(inertia[i][i] for i in range(3)),
            inertia[0][1],
            inertia[0][2],
            inertia[1][2],
        ]
    )


def pack_legs(rig: RigFile) -> Array:
    """(n, 6): mass kg, cog m, inertia kg·m² of each actuator's lower, then upper part."""
    return np.array(
        [
            [
                a.leg.lower_mass,
                a.leg.lower_cog,
                a.leg.lower_inertia,
                a.leg.upper_mass,
                a.leg.upper_cog,
                a.leg.upper_inertia,
            ]
            for a in rig.actuators
        ]
    )


def pack_fed_legs(rig: RigFile) -> Array:
    """`pack_legs` as the static force that is fed forward knows them."""
    legs = pack_legs(rig)
    legs[[not a.leg.is_fed for a in rig.actuators]] = 0.0
    return legs


def pack_gravity(rig: RigFile) -> Array:
    """Gravity vector in the base frame of a level rig, m/s²."""
    return np.array([0.0, 0.0, -rig.mass.gravity])


def pack_reflected(rig: RigFile) -> Array:
    """Reflected rotor masses (n,), kg, or kg·m² for a rotary actuator."""
    return np.array([a.reflected_mass for a in rig.actuators])
