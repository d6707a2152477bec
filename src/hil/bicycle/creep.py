"""How a driving tyre creeps: it turns further than it rolls, by so much for each m/s² that it drives with.

What it drives with is the force on its flank of the road, not what the bicycle speeds up by: one that swings
from side to side goes faster and slower by itself. Where the wheel is what is known, a bicycle on a tyre that
creeps follows it late, by creep times speed.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from hil.compiled import compiled

Array = NDArray[np.float64]


def turns(rate: Array, drive: Array, creep: float) -> Array:
    """(N,) rate of a wheel, rad/s, that would roll at `rate` (N,) and drives with `drive` (N,), m/s² for each
    kg of all; `creep` in s²/m."""
    return np.asarray(rate * (1.0 + creep * drive))


@compiled
def rolls(
    rate: Array, acceleration: Array, drive: Array, creep: float, radius_m: float, dt_s: float
) -> Array:
    """(N,) rate, rad/s, at which a wheel rolls that turns at `rate`, speeding up by `acceleration` (rad/s²).

    `drive` (N,): what it would drive with, m/s², did it not creep; `creep` in s²/m. What it creeps by it does
    not speed up by, so that it drives with less: r + creep rate (drive + radius_m (r' - acceleration)) is the
    rate, solved for r with the rest straight between samples, `dt_s` apart.
    """
    out = np.empty_like(rate)
    before = 0.0
    for k in range(len(rate)):
        late_s = creep * radius_m * abs(rate[k])
        meant = rate[k] - creep * rate[k] * (drive[k] - radius_m * acceleration[k])
        if k == 0 or late_s < 1e-9:
            out[k] = rate[k] * (1.0 - creep * drive[k])
        else:
            a = dt_s / late_s
            left = math.exp(-a)
            share = (1.0 - left) / a
            out[k] = left * out[k - 1] + (share - left) * before + (1.0 - share) * meant
        before = meant
    return out
