"""The model of a rig file, with the friction that its drives feed forward: its effects' friction too.

A rig file's effects are known to whoever is set up by the file, so a drive with friction pre-control
(`friction_ff`) feeds them forward. An effect that nobody knows of is not in the file: see `hidden` of
`hil.sim.plant.Plant`.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hil.config import RigFile
from hil.control.friction import known_friction
from hil.sim import layout as lay
from hil.sim.model import actuator_rows, pack_model


def pack_known(rig: RigFile, substeps: int = 1, *, smooth: bool = False) -> NDArray[np.float64]:
    """`hil.sim.model.pack_model`, drives set up by the whole file; a drive knows one Coulomb force."""
    model = pack_model(rig, substeps, smooth=smooth)
    friction, rows = known_friction(rig), actuator_rows(model)
    rows[lay.A_FF_VISCOUS] = friction.viscous
    rows[lay.A_FF_COULOMB] = 0.5 * (friction.positive + friction.negative)
    return model
