"""Friction of one actuator: its level while sliding, and what bristles or slip elements make of it."""

from __future__ import annotations

from math import copysign, exp

import numpy as np
from numba import njit

from benchmarks.third_lab import columns as c

SLIP_YIELDS = np.array([0.35, 0.8, 1.4, 2.2])
"""Yield displacements of the four Maxwell elements over the presliding displacement."""


@njit(cache=True)
def level(
    row: np.ndarray, v: float, x: float, load: float, t: float, brake: float
) -> tuple[float, float]:
    """Sliding friction (N) towards plus and towards minus at speed `v`, transmitted force `load`."""
    extra = row[c.STATIC_EXTRA] * exp(-((abs(v) / row[c.STRIBECK_V]) ** row[c.STRIBECK_POWER]))
    extra += row[c.BRAKE] * brake
    if row[c.SPOT] != 0.0:
        extra += row[c.SPOT] * exp(-(((x - row[c.SPOT_X]) / row[c.SPOT_WIDTH]) ** 2))
    against, along = row[c.LOAD_AGAINST] * abs(load), row[c.LOAD_WITH] * abs(load)
    plus = row[c.COULOMB_POS] + extra + (against if load > 0.0 else along)
    minus = row[c.COULOMB_NEG] + extra + (along if load > 0.0 else against)
    warm = warmth(row, t)
    return plus * warm, minus * warm


@njit(cache=True)
def warmth(row: np.ndarray, t: float) -> float:
    """What running for `t` s has made of friction, 1 at the start."""
    if row[c.WARM] == 0.0 or t <= 0.0:
        return 1.0
    return 1.0 + row[c.WARM] * (1.0 - exp(-t / row[c.WARM_TAU]))


@njit(cache=True)
def slide(row: np.ndarray, z: np.ndarray, dx: float, plus: float, minus: float) -> float:
    """Friction force (N, against plus) after a travel `dx`; `z`: the elements' deflections, updated."""
    if row[c.LAW] == 0.0:
        total = 0.0
        for k in range(4):
            yields = SLIP_YIELDS[k] * row[c.PRESLIDING]
            z[k] = min(max(z[k] + dx, -yields), yields)
            total += 0.25 * z[k] / yields
    else:
        bend = row[c.PRESLIDING]
        end = copysign(bend, dx)
        z[0] = end + (z[0] - end) * exp(-abs(dx) / bend)
        total = z[0] / bend
    return total * (plus if total > 0.0 else minus)


@njit(cache=True)
def hysteresis(row: np.ndarray, z: float, dx: float) -> float:
    """Next normalised state of the elastic-plastic element, between -1 and 1."""
    if row[c.HYST_POWER] == 1.0:
        end = copysign(1.0, dx)
        return end + (z - end) * exp(-abs(dx) / row[c.HYST_D])
    stays = 1.0 - z * z * (0.5 + 0.5 * copysign(1.0, dx * z))
    return min(max(z + dx / row[c.HYST_D] * stays, -1.0), 1.0)
