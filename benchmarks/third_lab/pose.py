"""Kinematics and statics: setpoints of a nominal rig for a cue, and how a plant stands at rest."""

from __future__ import annotations

from math import pi

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.third_lab import columns as c
from benchmarks.third_lab.engine import LINE, PLANE
from benchmarks.third_lab.plant import Plant


def platform(kind: str, geometry: object, pose: np.ndarray) -> tuple[np.ndarray, Rotation]:
    """Origin (k, 3) and attitude of the nominal platform at `pose` (k, coordinates).

    Attitude is R_z(yaw) R_y(pitch) R_x(roll) of both platforms; the motorcycle's origin follows from its
    slide's line: x = -L + l3 r11 + h3 r13, y = 0, z = h + l3 r31 + h3 r33.
    """
    k = len(pose)
    if kind == "axis_1dof":
        return np.column_stack([pose[:, 0], np.zeros((k, 2))]), Rotation.identity(k)
    g = geometry
    if kind == "motorcycle_3dof":
        turned = Rotation.from_euler("ZYX", pose)
        r = turned.as_matrix()
        x = -g.L + g.l3 * r[:, 0, 0] + g.h3 * r[:, 0, 2]
        z = g.h + g.l3 * r[:, 2, 0] + g.h3 * r[:, 2, 2]
        return np.column_stack([x, np.zeros(k), z]), turned
    turned = Rotation.from_euler("ZYX", pose[:, [5, 4, 3]])
    return pose[:, :3] + [0.0, 0.0, g.height], turned


def lengths(plant: Plant, origin: np.ndarray, turned: Rotation) -> tuple[np.ndarray, np.ndarray]:
    """Length (k, 6) and direction (k, 6, 3) of every member."""
    r = turned.as_matrix()
    gone = origin[:, None, :] + np.einsum("kij,mj->kmi", r, plant.cabin) - plant.base
    gone[:, plant.kind == PLANE, 1] = 0.0
    length = np.linalg.norm(gone, axis=2)
    along = gone / np.maximum(length, 1e-12)[:, :, None]
    for m in np.flatnonzero(plant.kind == LINE):
        along[:, m] = plant.line[m]
        length[:, m] = gone[:, m] @ plant.line[m]
    return length, along


def setpoints(plant: Plant, pose: np.ndarray) -> np.ndarray:
    """Actuators' nominal positions (k, n) at `pose`; `plant` is the nominal one."""
    rig = plant.rig
    length, _ = lengths(plant, *platform(rig.kind, rig.geometry, pose))
    return length[:, plant.actuated >= 0]


def wrench_map(plant: Plant, along: np.ndarray, turned: Rotation) -> np.ndarray:
    """(k, 6, 6): force and moment about the centre of gravity of unit forces of the members."""
    arms = np.einsum("kij,mj->kmi", turned.as_matrix(), plant.cabin - plant.cog)
    return np.concatenate([along, np.cross(arms, along)], axis=2).transpose(0, 2, 1)


def reach(row: np.ndarray, counted: float) -> float:
    """Length that an actuator gives its member when its motor counts `counted`."""
    travel = counted - row[c.HOME]
    wave = np.sin(2.0 * pi * travel / row[c.LEAD_PERIOD] + row[c.LEAD_PHASE])
    return float(row[c.HOME] + row[c.LEAD] * travel + row[c.LEAD_AMPLITUDE] * wave + row[c.OFFSET])


def rest(plant: Plant, motors: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Where the body rests with its motors held: origin (3,), quaternion w x y z, members' forces (6,).

    Newton on six members that bend under the weight.
    """
    rig = plant.rig
    origin, turned = platform(rig.kind, rig.geometry, np.zeros((1, len(rig.coordinates))))
    origin = origin[0]
    wanted, stiffness = plant.passive[:, 0].copy(), plant.passive[:, 1].copy()
    play = np.zeros(6)
    for m in np.flatnonzero(plant.actuated >= 0):
        row = plant.act[plant.actuated[m]]
        wanted[m] = reach(row, motors[plant.actuated[m]])
        stiffness[m], play[m] = row[c.STIFFNESS], 0.5 * row[c.GAP] + 0.5 * row[c.FLANK]
    weight = np.concatenate([-plant.mass * plant.gravity, np.zeros(3)])
    force = np.zeros(6)
    for _ in range(12):
        length, along = lengths(plant, origin[None], turned)
        across = wrench_map(plant, along, turned)[0]
        force = np.linalg.solve(across, weight)
        bend = force / stiffness + np.where(np.abs(force) > 1.0, np.sign(force) * play, 0.0)
        step = np.linalg.solve(across.T, wanted - bend - length[0])
        arm = turned.apply(plant.cog)[0]
        turned = Rotation.from_rotvec(step[3:]) * turned
        origin = origin + step[:3] + arm - turned.apply(plant.cog)[0]
    q = turned.as_quat()[0]
    return origin, q[[3, 0, 1, 2]], force
