"""A rig of the exam's world built: its file, scattered a little everywhere, with effects put in."""

from __future__ import annotations

import numpy as np

from hil.config import Effect, RigFile
from hil.exam.world import layout as lay
from hil.exam.world.body import Outside, World, add_point_mass
from hil.exam.world.effects import apply_effect
from hil.exam.world.outside import apply_outside
from hil.exam.world.scatter import Scatter, scattered


def build_world(
    rig: RigFile,
    scatter: Scatter,
    effects: tuple[Effect, ...] = (),
    outside: tuple[Outside, ...] = (),
    payload: tuple[float, float, float, float] | None = None,
) -> World:
    """The rig with its scatter, its own file's effects and these; payload: kg at x, y, z m."""
    world = scattered(rig, np.random.default_rng([scatter.seed, 71]), scatter.size)
    if payload is not None:
        add_point_mass(world.true[1], payload[0], np.array(payload[1:]))
    for effect in (*rig.effects, *effects):
        apply_effect(world, effect)
    for kind in outside:
        apply_outside(world, kind.kind, kind.location, kind.parameters)
    for i in range(world.act.shape[1]):  # bristles as stiff as they are strong
        coulomb = world.act[lay.A_COULOMB, i]
        level = coulomb + 0.5 * (world.act[lay.A_POSITIVE, i] + world.act[lay.A_NEGATIVE, i])
        world.act[lay.A_BRISTLE, i] *= max(
            level + world.act[lay.A_STRIBECK, i], 0.3 * coulomb, 1e-3
        )
    return world
