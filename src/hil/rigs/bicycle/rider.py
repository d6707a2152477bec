"""The upper body of a rider: whether it can be a part of body 3, and a usual one for a file that has none."""

from __future__ import annotations

from typing import Final

from hil.config.bicycle import BicycleFile, Rider

UPPER: Final = 0.47
"""Of the mass of a frame with its rider, that of the upper body: trunk, arms and head [R]."""
LOWER_M: Final = 0.06
"""m by which it turns below the centre of gravity of both [R]."""
HEIGHT_M: Final = 0.3
TURNING_M2: Final = 0.0475
"""m², its moment of inertia by its mass [R]."""
RIDDEN_KG: Final = 50.0
"""A lighter frame carries no rider."""


def impossible_rider(rig: BicycleFile) -> str | None:
    """A sentence where the upper body cannot be a part of body 3.

    What is left of body 3 without it has what the parallel axes leave of its moment about the forward axis.
    """
    rider, (frame, gravity) = rig.rider, (rig.mass.m[1], rig.mass.G3[2])
    rest = frame - rider.mass  # the rig file keeps it above 0
    apart = rider.pivot[2] + rider.height - gravity
    left = rig.mass.I3[0] - rider.inertia - rider.mass * frame / rest * apart**2
    if rider.mass == 0.0 or left > 0.0:
        return None
    return (
        f"rider: an upper body of {rider.mass:g} kg with its centre of gravity {apart:+.2g} m above body 3's "
        f"leaves the rest of it {left:.2g} kg·m² about the forward axis, not above 0: its mass, height or "
        "inertia are too large, or mass.I3 is too small"
    )


def with_usual_rider(rig: BicycleFile) -> BicycleFile | None:
    """`rig`, whose file says nothing of a rider, with one of usual size; None where it says something, be it
    that he never leans, or nobody rides it."""
    frame, (x, y, z) = rig.mass.m[1], rig.mass.G3
    if "rider" in rig.model_fields_set or frame < RIDDEN_KG:
        return None
    mass = round(UPPER * frame, 1)
    rider = Rider(
        mass=mass,
        pivot=(x, y, round(z - LOWER_M, 3)),
        height=HEIGHT_M,
        inertia=round(TURNING_M2 * mass, 2),
    )
    ridden = rig.model_copy(update={"rider": rider})
    return None if impossible_rider(ridden) else ridden
