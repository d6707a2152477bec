"""The bare inverse dynamics of a rig, without leaving compiled code, as plant and twin run it."""

from __future__ import annotations

from typing import Any

from numba import njit

from hil.config import RigFile
from hil.rigs import solutions
from hil.rigs.pack import (
    kind_code,
    pack_body,
    pack_geometry,
    pack_gravity,
    pack_legs,
    pack_reflected,
)


def packed_model(rig: RigFile) -> tuple[Any, ...]:
    """The rig as the compiled functions take it."""
    return (
        kind_code(rig),
        pack_geometry(rig),
        pack_body(rig),
        pack_legs(rig),
        pack_gravity(rig),
        pack_reflected(rig),
    )


@njit
def compiled_dynamics(  # type: ignore[no-untyped-def]
    kind, geometry, body, legs, gravity, reflected, q, qd, qdd
):
    """Inverse dynamics of all states (k, n); returns the sum of first forces, so that none is left out."""
    total = 0.0
    for i in range(q.shape[0]):
        force, _ = solutions.inverse_dynamics(
            kind, geometry, body, legs, gravity, reflected, q[i], qd[i], qdd[i]
        )
        total += force[0]
    return total
