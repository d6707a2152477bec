"""Friction on the motor's side: LuGre, Maxwell-slip and tanh laws, and a Bouc-Wen spring.

One bound g(v) serves all laws: Coulomb by direction, a Stribeck excess of one of two shapes, load, brake
and cable parts, all times the warmth of the lubricant.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from benchmarks.other_lab import layout as lay

SHARES = np.array([0.4, 0.3, 0.2, 0.1])
"""Maxwell-slip: share of the force of each element; yield points double from one to the next."""


@njit(cache=True)
def bound(act, i, v, load, more, warmth):
    """Largest friction at speed v, N; `load` transmitted, `more` of brake and cable."""
    g = act[lay.COUL_P, i] if v >= 0.0 else act[lay.COUL_N, i]
    if act[lay.STAT, i] != 0.0:
        x = abs(v) / act[lay.VSTR, i]
        shape = act[lay.SHAPE, i]
        g += act[lay.STAT, i] * (1.0 / (1.0 + x * x) if shape == 0.0 else math.exp(-(x**shape)))
    g += act[lay.LOADMU, i] * abs(load)
    return max(g * warmth + more, 1e-3)


@njit(cache=True)
def presliding(act, i, v, g, z, h):
    """(force, slope): friction of bound g at speed v and what it grows with speed; z (4,) inner states."""
    law = act[lay.LAW, i]
    if law == lay.TANH:
        t = math.tanh(v / act[lay.SIG0, i])
        return g * t, g * (1.0 - t * t) / act[lay.SIG0, i]
    if law == lay.LUGRE:
        stiffness = act[lay.SIG0, i]
        end = math.copysign(g / stiffness, v)
        before = z[0]
        z[0] = end + (before - end) * math.exp(-stiffness * abs(v) * h / g)
        return stiffness * z[0] + act[lay.SIG1, i] * (z[0] - before) / h, 0.0
    force = 0.0
    limit = act[lay.SIG0, i]
    for k in range(4):
        z[k] = min(max(z[k] + v * h, -limit), limit)
        force += g * SHARES[k] * z[k] / limit
        limit *= 2.0
    return force, 0.0


@njit(cache=True)
def bouc_wen(act, i, v, z, h):
    """Next state of the hysteresis spring, -1..1."""
    rate = v / act[lay.HYS_D, i]
    back = abs(z) ** act[lay.HYS_N, i] if rate * z > 0.0 else 0.0
    return min(max(z + rate * (1.0 - back) * h, -1.0), 1.0)
