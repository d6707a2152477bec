"""A weighed payload on the simulated rig, as effects of the catalogue that its rig file does not know."""

from __future__ import annotations

from typing import Final

import numpy as np

from hil.config import Effect, RigFile
from hil.errors import ConfigError
from hil.runs.folder import Payload

SMALL_KG_M2: Final = 1.0e-6


def bolted(rig: RigFile, payload: Payload) -> tuple[Effect, ...]:
    """The effects of a point mass at the payload's place on the platform (parallel axes).

    ConfigError where it would tilt the principal axes: the catalogue has moments of inertia alone.
    """
    own, added = rig.mass.m, payload.mass
    apart = np.array([payload.x, payload.y, payload.z]) - np.array(rig.mass.cog)
    shift = added / (own + added) * apart
    spread = own * shift[:, None] * -apart[None, :]
    np.fill_diagonal(spread, own * float(shift @ apart) + np.diag(spread))
    if np.abs(spread - np.diag(np.diag(spread))).max() > SMALL_KG_M2:
        raise ConfigError(
            f"payload: {added:g} kg at {apart[0]:+g}, {apart[1]:+g}, {apart[2]:+g} m from the centre of "
            "gravity would tilt the principal axes, which the simulated rig cannot: put it at the centre "
            f"of gravity ({', '.join(f'{x:g}' for x in rig.mass.cog)}) or beside it along one axis"
        )
    return (
        Effect(effect="payload_mass", location="platform", parameters={"mass": added}),
        Effect(
            effect="payload_cog",
            location="platform",
            parameters=dict(zip("xyz", shift.tolist(), strict=True)),
        ),
        Effect(
            effect="payload_inertia",
            location="platform",
            parameters=dict(zip(("xx", "yy", "zz"), np.diag(spread).tolist(), strict=True)),
        ),
    )
