"""Steps that noise blurs: rounded before the noise came on, values gather near a grid; no two are alike."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

BINS: Final = 8
"""Of the finest step, for counting values."""
MOST_BINS: Final = 1 << 20
COARSEST: Final = 1.25
"""Times the step that would leave what is left: rounding cannot leave less."""
LEVELS: Final = 10
"""Steps that the values must keep to at least."""
GATHERED: Final = 0.3
"""Mean length of the values' directions about a grid from which on they gather at it: noise of a quarter of a
step leaves that much."""
LOUDER: Final = 1.4
"""Times the noise of the rig file that may blur them."""
WITH_NOISE: Final = 0.85
"""Of what that noise would leave of it: a rig that itself moves in steps has values between them."""
OWN: Final = 0.5
"""Of that, what the twin's answers have of the same: motion of an even speed, or places of rest."""


def blurred_step(values: Array, residual: Array, spread: float, finest: float) -> float | None:
    """The step, `finest` at least, of a grid at which `values` gather and what the twin answers does not.

    `values`, `residual`: (N,), in the signal's unit, as are `finest` and the noise's `spread`. None where
    there is no such grid, or where rounding to it would leave more than the `residual`.
    """
    if len(values) < LEVELS:
        return None
    coarsest = COARSEST * np.sqrt(12.0) * float(np.sqrt(np.mean(residual**2)))
    rate = _nearest(values, finest, min(coarsest, float(np.ptp(values)) / LEVELS))
    if rate is None:
        return None
    gathered = min(_gathered(values, rate), _by_level(values, rate))
    blur = float(np.exp(-0.5 * (2.0 * np.pi * LOUDER * spread * rate) ** 2))
    if gathered < max(GATHERED, WITH_NOISE * blur):
        return None
    if _gathered(values - residual, rate) > OWN * gathered:
        return None
    return 1.0 / rate


def _gathered(values: Array, rate: float) -> float:
    return float(abs(np.mean(np.exp(2j * np.pi * rate * values))))


def _by_level(values: Array, rate: float) -> float:
    """The same, each level counting alike: a few places of rest gather at many grids. Lone values at many
    levels count for much here, by chance as well, and for little there."""
    way = np.exp(2j * np.pi * rate * values)
    turn = float(np.angle(np.mean(way))) / (2.0 * np.pi)
    levels, level = np.unique(np.round(values * rate - turn), return_inverse=True)
    if len(levels) < LEVELS:
        return 0.0
    at = np.bincount(level, way.real) + 1j * np.bincount(level, way.imag)
    return float(abs(np.mean(at / np.bincount(level))))


def _nearest(values: Array, finest: float, coarsest: float) -> float | None:
    """Steps in a unit of the grid that the values are nearest to."""
    low, span = float(values.min()), float(np.ptp(values))
    if coarsest <= finest or BINS * span > MOST_BINS * finest:
        return None
    bins = int(np.ceil(BINS * span / finest))
    counts, _ = np.histogram(values, bins, (low, low + span))
    rates = np.fft.rfftfreq(4 * bins, span / bins)
    gathered = np.abs(np.fft.rfft(counts, 4 * bins))
    gathered[(rates < 1.0 / coarsest) | (rates > 1.0 / finest)] = 0.0
    rate = float(rates[np.argmax(gathered)])
    for fine in (0.1 * float(rates[1]), 0.005 * float(rates[1])):
        near = rate + fine * np.arange(-12, 13)
        rate = float(near[np.argmax([_gathered(values, float(r)) for r in near])])
    return rate
