"""Friction of the actuators: how large it may be, and the exact box problem of stick and slip.

Friction acts on the motor side of a transmission. Coulomb-like parts give a band -lo..hi for the force
that opposes motion; whether an actuator slips (force at the band's end) or sticks (velocity exactly zero,
force inside the band) follows for all actuators together from v = v_free + W phi, W symmetric and positive
definite: a box-constrained complementarity problem, solved by an active set that starts from the last
step's answer, so nearly every step needs one pass. It has one solution, continuous in all parameters.
"""

from __future__ import annotations

import math

from hil.compiled import inner
from hil.sim import layout as lay

GUIDE_M = 1e-5
"""Way (m, rad) within which the friction of a load's guides builds up [R: rolling guides 5 to 20 µm]."""
SWEEPS = 400
"""Gauss-Seidel sweeps if the active set should cycle: a net that keeps the answer right, if slower."""


@inner
def friction_band(act, st, i):  # type: ignore[no-untyped-def]
    """(lo, hi) >= 0: largest friction force against negative and against positive motion of motor i.

    Stribeck: F = F_C + (F_S - F_C) exp(-(v / v_S)^2) [M: Armstrong-Helouvry's survey]. Load friction
    grows with the force transmitted in the last step, by (1 + asymmetry) when moving against the load.
    """
    extra = act[lay.A_STRIBECK_C, i]
    if act[lay.A_STRIBECK_D, i] != 0.0:
        x = st[lay.S_VM, i] / act[lay.A_STRIBECK_V, i]
        extra += act[lay.A_STRIBECK_D, i] * math.exp(-x * x)
    lo = act[lay.A_COULOMB_NEG, i] + extra
    hi = act[lay.A_COULOMB_POS, i] + extra
    if act[lay.A_LOAD, i] != 0.0:
        load = act[lay.A_LOAD, i] * st[lay.S_LOAD, i]
        lo += abs(load) - act[lay.A_LOAD_ASYM, i] * load
        hi += abs(load) + act[lay.A_LOAD_ASYM, i] * load
    if st[lay.S_BRAKE, i] != 0.0:
        lo += act[lay.A_BRAKE, i]
        hi += act[lay.A_BRAKE, i]
    return max(lo, 0.0), max(hi, 0.0)


@inner
def hysteresis_advance(z, dx, displacement):  # type: ignore[no-untyped-def]
    """Dahl's state z in -1..1 after travel dx: rate-independent, exact for one direction of travel."""
    if dx == 0.0:
        return z
    end = math.copysign(1.0, dx)
    return end + (z - end) * math.exp(-abs(dx) / displacement)


@inner
def bristle_advance(bent, lo, hi, dx, way):  # type: ignore[no-untyped-def]
    """Force of bent bristles, against positive motion, after travel dx: towards the friction of that
    direction, -lo or hi, within `way`; no change of friction pushes before it is travelled."""
    if dx == 0.0:
        return bent
    end = hi if dx > 0.0 else -lo
    return end + (bent - end) * math.exp(-abs(dx) / way)


@inner
def bristle_drag(bent, lo, hi, v, h, way):  # type: ignore[no-untyped-def]
    """By what such bristles resist more, on average over a step h, for the sum of the velocities before and
    after it, N·s/m."""
    more = abs(-lo - bent) if v < 0.0 else abs(hi - bent)
    return 0.25 * h * more / way


@inner
def solve_stick_slip(W, v_free, lo, hi, slip, phi, K, y):  # type: ignore[no-untyped-def]
    """Friction forces phi (n,) with v = v_free + W phi, phi = -hi where v > 0, lo where v < 0, between
    where v = 0. `slip` (n,) is the guess on entry (1, -1, 0 = stick) and the answer on return; K (n,n)
    and y (n,) are scratch. Returns the number of passes.
    """
    n = v_free.shape[0]
    for attempt in range(4 * n + 4):
        m = 0
        for i in range(n):
            if slip[i] > 0.0:
                phi[i] = -hi[i]
            elif slip[i] < 0.0:
                phi[i] = lo[i]
        # Cholesky of W over the sticking set, right-hand side = minus what the others do there
        r = 0
        for i in range(n):
            if slip[i] != 0.0:
                continue
            x = -v_free[i]
            for j in range(n):
                if slip[j] != 0.0:
                    x -= W[i, j] * phi[j]
            c = 0
            for j in range(i + 1):
                if slip[j] != 0.0:
                    continue
                s = W[i, j]
                for k in range(c):
                    s -= K[r, k] * K[c, k]
                K[r, c] = s / K[c, c] if c < r else math.sqrt(s)
                c += 1
            for k in range(r):
                x -= K[r, k] * y[k]
            y[r] = x / K[r, r]
            r += 1
        m = r
        for r in range(m - 1, -1, -1):
            x = y[r]
            for k in range(r + 1, m):
                x -= K[k, r] * y[k]
            y[r] = x / K[r, r]
        changed = False
        r = 0
        for i in range(n):
            if slip[i] == 0.0:
                phi[i] = y[r]
                r += 1
        for i in range(n):
            if slip[i] == 0.0:
                if phi[i] > lo[i]:
                    slip[i] = -2.0  # becomes negative slip once all are judged
                elif phi[i] < -hi[i]:
                    slip[i] = 2.0
            else:
                v = v_free[i]
                for j in range(n):
                    v += W[i, j] * phi[j]
                if v * slip[i] < 0.0:
                    slip[i] = 3.0 if lo[i] + hi[i] > 0.0 else 4.0 * math.copysign(1.0, v)
        for i in range(n):
            if abs(slip[i]) > 1.5:
                changed = True
                slip[i] = 0.0 if slip[i] == 3.0 else math.copysign(1.0, slip[i])
        if not changed:
            return attempt + 1
    for i in range(n):
        phi[i] = min(max(phi[i], -hi[i]), lo[i])
    for _ in range(SWEEPS):
        for i in range(n):
            v = v_free[i]
            for j in range(n):
                v += W[i, j] * phi[j]
            phi[i] = min(max(phi[i] - v / W[i, i], -hi[i]), lo[i])
    for i in range(n):
        slip[i] = -1.0 if phi[i] >= lo[i] else (1.0 if phi[i] <= -hi[i] else 0.0)
    return 4 * n + 4 + SWEEPS
