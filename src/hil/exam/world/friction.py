"""Friction of the exam's world: bristles (LuGre), Bouc-Wen hysteresis, a seal that grips at rest.

LuGre [M: Canudas de Wit, Olsson, Astrom, Lischinsky 1995] with a level g that depends on speed (Stribeck),
direction, place and load; its bristle state is advanced exactly for the speed of the step, so stiff
bristles need no small steps. Bouc-Wen [M: Wen 1976] with exponent and shape of its own.
"""

from __future__ import annotations

import math

from hil.compiled import inner
from hil.exam.world import layout as lay

CREEP = 1e-9
REST_MS = 3e-4
"""Below this speed (m/s or rad/s) a seal counts as resting."""
SEAL_M = 3e-4
"""Way after which a seal has let go."""


@inner
def level(act, st, i):  # type: ignore[no-untyped-def]
    """Friction level g >= 0 that actuator i tends to at its present speed, place, direction and load."""
    v, x = st[lay.S_V, i], st[lay.S_X, i]
    own = act[lay.A_COULOMB, i]
    s = v / 0.01
    own *= 1.0 + act[lay.A_FRICTION_V, i] * math.exp(-abs(s))
    turn = 2.0 * math.pi * x / act[lay.A_FRICTION_L, i] + act[lay.A_FRICTION_PHASE, i]
    own *= 1.0 + act[lay.A_FRICTION_X, i] * math.sin(turn)
    g = own + (act[lay.A_POSITIVE, i] if v > 0.0 else act[lay.A_NEGATIVE, i])
    if act[lay.A_STRIBECK, i] != 0.0:
        s = v / act[lay.A_STRIBECK_V, i]
        g += act[lay.A_STRIBECK, i] * math.exp(-s * s)
    if act[lay.A_LOAD, i] != 0.0:
        load = st[lay.S_LOAD, i]
        against = load * v > 0.0
        way = 1.0 + act[lay.A_LOAD_ASYM, i] if against else 1.0 - act[lay.A_LOAD_ASYM, i]
        g += act[lay.A_LOAD, i] * abs(load) * way
    return max(g, 0.0)


@inner
def bristle_force(act, st, i, h):  # type: ignore[no-untyped-def]
    """Advance the bristles of actuator i by h; the force with which they oppose positive motion."""
    g, v = level(act, st, i), st[lay.S_V, i]
    sigma = act[lay.A_BRISTLE, i]
    z = st[lay.S_BRISTLE, i]
    if g <= 0.0:
        st[lay.S_BRISTLE, i] = 0.0
        return 0.0
    if abs(v) < CREEP:
        new = z + v * h
    else:
        end = math.copysign(g / sigma, v)
        new = end + (z - end) * math.exp(-sigma * abs(v) * h / g)
    st[lay.S_BRISTLE, i] = new
    damping = 0.6 * math.sqrt(sigma * act[lay.A_MASS, i]) * math.exp(-((v / 0.002) ** 2))
    return sigma * 0.5 * (z + new) + damping * (new - z) / h


@inner
def hysteresis_force(act, st, i, h):  # type: ignore[no-untyped-def]
    """Advance the Bouc-Wen state of actuator i by h; its force against positive displacement."""
    z, dx = st[lay.S_HYST, i], st[lay.S_V, i] * h / act[lay.A_HYST_X, i]
    b = act[lay.A_HYST_B, i]
    way = 1.0 if z * dx > 0.0 else -1.0
    z += dx * (1.0 - abs(z) ** act[lay.A_HYST_N, i] * (1.0 - b + b * way))
    st[lay.S_HYST, i] = min(max(z, -1.2), 1.2)
    return act[lay.A_HYST_F, i] * z


@inner
def seal_force(act, st, i, h):  # type: ignore[no-untyped-def]
    """Grip of a seal that grows while actuator i rests and lets go over the first bit of way."""
    v = st[lay.S_V, i]
    if abs(v) < REST_MS:
        st[lay.S_REST, i] += h
        st[lay.S_SEAL, i] = 1.0 - math.exp(-st[lay.S_REST, i] / act[lay.O_SEAL_TAU, i])
        st[lay.S_SEAL_X, i] = 0.0
    else:
        st[lay.S_SEAL_X, i] += abs(v) * h
        if st[lay.S_SEAL_X, i] > 4.0 * SEAL_M:
            st[lay.S_REST, i] = 0.0
    grip = st[lay.S_SEAL, i] * math.exp(-st[lay.S_SEAL_X, i] / SEAL_M)
    return act[lay.O_SEAL_F, i] * grip * math.tanh(v / 5e-4)
