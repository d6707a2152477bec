"""How tyres and fork give way: a plane bicycle of four masses on two springs, three with a sprung fork.

Coordinates are the heights of both wheel centres and the fork's travel, counted from where the bicycle
stands with its rider. Drive and brake act at the rear wheel, so that the chain's pull pitches the frame
as if every mass were pushed at its height above the road.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numba
import numpy as np
from numpy.typing import NDArray

from hil.config import BicycleFile

Array = NDArray[np.float64]

UNSPRUNG_KG: Final = 0.5
"""Of the fork, that moves with the front wheel [M]."""
SLIDING_M_S: Final = 0.004
"""Speed at which the fork's stick friction is nearly all there."""


@dataclass(frozen=True, slots=True)
class Springs:
    """Tyres and fork: force = stiffness x (1 + progress x) + damping x' in compression, x (m) from rest, and
    dry friction in the fork."""

    tyre: float
    """N/m of either tyre, at rest."""
    tyre_damping: float
    tyre_progress: float
    """1/m."""
    fork: float = np.inf
    fork_damping: float = 0.0
    fork_progress: float = 0.0
    fork_friction: float = 0.0
    """N."""


@dataclass(frozen=True, slots=True)
class Deflection:
    """(N,) each, m: squash of rear and front tyre, travel of the fork (compressed positive)."""

    rear: Array
    front: Array
    travel: Array


def deflection(
    rig: BicycleFile,
    springs: Springs,
    dt_s: float,
    acceleration: Array,
    speed: Array,
    weight: Array,
    road: tuple[Array, Array],
) -> Deflection:
    """Under an acceleration along the road and a weight in excess of the resting one, m/s2 both."""
    mass, along, down, blown, topple = _plane(rig)
    force = along[:, None] * acceleration + down[:, None] * weight + blown[:, None] * speed**2
    sprung = np.isfinite(springs.fork)
    if not sprung:
        mass[2, :2], mass[:2, 2], mass[2, 2], force[2] = 0.0, 0.0, 1.0, 0.0
        topple[2, :], topple[:, 2] = 0.0, 0.0
    s = springs
    fork = (s.fork, s.fork_damping, s.fork_progress, s.fork_friction) if sprung else (0.0,) * 4
    tyre = (s.tyre, s.tyre_damping, s.tyre_progress)
    heights = np.stack(road)
    y = _moved(mass, topple, force, heights, np.gradient(heights, dt_s, axis=1), tyre, fork, dt_s)
    return Deflection(heights[0] - y[0], heights[1] - y[1], y[2])


def _plane(rig: BicycleFile) -> tuple[Array, Array, Array, Array, Array]:
    """Mass matrix (3, 3), loads (3,) of acceleration, weight and squared speed, and what weight takes from
    the stiffness (3, 3): a body that stands high tips the further the bicycle has pitched."""
    g, m = rig.geometry, rig.mass
    pitch = np.array([1.0, -1.0, np.cos(g.tilt)]) / g.wheelbase
    up, slide = np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0])
    mass, topple, along, down = np.zeros((3, 3)), np.zeros((3, 3)), np.zeros(3), np.zeros(3)
    raked = np.sin(g.tilt) / g.wheelbase * (np.outer(pitch, slide) + np.outer(slide, pitch))
    front_z = g.front_radius - g.R
    bodies = (
        (m.m[0], 0.0, 0.0, 0.0, 0.0),
        (m.m[1], m.G3[0], m.G3[2], m.I3[1], 0.0),
        (m.m[2] - UNSPRUNG_KG, m.G4[0], m.G4[2], m.I4[1], 0.0),
        (m.m[3] + UNSPRUNG_KG, g.wheelbase, front_z, 0.0, 1.0),
    )
    for kg, x, z, inertia, slides in bodies:
        rise = up - x * pitch + slides * np.cos(g.tilt) * slide
        ahead = z * pitch - slides * np.sin(g.tilt) * slide
        pushed = ahead + g.R * pitch
        mass += kg * (np.outer(rise, rise) + np.outer(pushed, ahead))
        mass += inertia * np.outer(pitch, pitch)
        along += kg * pushed
        down += kg * rise
        topple += kg * m.gravity * (z * np.outer(pitch, pitch) + (1.0 - slides) * x * raked)
    along += pitch * (m.I2[1] / g.R + g.R * m.I5[1] / g.front_radius**2)
    return mass, along, down, rig.aero * (m.G3[2] + g.R) * pitch, topple


@numba.njit(cache=True)
def _progressive(x, progress):
    """Deflection as the spring feels it: slope 1 at rest, more in compression, less (never none) beyond."""
    return x * (1.0 + progress * x) if x > 0.0 else x / (1.0 - progress * x)


@numba.njit(cache=True)
def _moved(mass, topple, load, heights, slopes, tyre, fork, dt):
    """Heights of the wheel centres and travel, (3, N): average acceleration, stiff parts implicit."""
    count = load.shape[1]
    effective = mass - 0.25 * dt * dt * topple
    for w in range(2):
        effective[w, w] += 0.5 * dt * tyre[1] + 0.25 * dt * dt * tyre[0]
    effective[2, 2] += 0.5 * dt * fork[1] + 0.25 * dt * dt * fork[0]
    inverse = np.linalg.inv(effective)
    out = np.zeros((3, count))
    y, v, a, force = np.zeros(3), np.zeros(3), np.zeros(3), np.zeros(3)
    for t in range(count):
        for k in range(3):
            y[k] += dt * v[k] + 0.25 * dt * dt * a[k]
            v[k] += 0.5 * dt * a[k]
        for w in range(2):
            squash = heights[w, t] - y[w]
            force[w] = tyre[0] * _progressive(squash, tyre[2]) + tyre[1] * (slopes[w, t] - v[w])
        force[2] = -fork[0] * _progressive(y[2], fork[2]) - fork[1] * v[2]
        force[2] -= fork[3] * np.tanh(v[2] / SLIDING_M_S)
        for k in range(3):
            for i in range(3):
                force[k] += topple[k, i] * y[i]
        for k in range(3):
            a[k] = 0.0
            for i in range(3):
                a[k] += inverse[k, i] * (force[i] - load[i, t])
        for k in range(3):
            y[k] += 0.25 * dt * dt * a[k]
            v[k] += 0.5 * dt * a[k]
            out[k, t] = y[k]
    return out
