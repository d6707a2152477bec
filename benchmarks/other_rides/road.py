"""The floor under the wheels: smooth as a hall's or good asphalt, filtered by the tyre's own length."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

Array = NDArray[np.float64]

SPACING_M: Final = 0.01
PATCH_M: Final = 0.03
"""Standard deviation of the tyre's footprint along the road."""
FALLS_M: Final = 6.0
"""Undulations longer than this are levelled: a slope is no roughness."""
ROUGHNESS_M3: Final = (0.02e-6, 0.2e-6)
"""Spectral density at 0.1 cycles/m, falling with the square: class A of ISO 8608 ends at 32e-6 [F], a
polished floor lies far below."""


def floor(rng: np.random.Generator, length_m: float, roughness_m3: float) -> Array:
    """Heights (m) every SPACING_M."""
    count = int(length_m / SPACING_M) + 2
    steps = rng.standard_normal(count) * 2.0 * np.pi * 0.1 * np.sqrt(roughness_m3 / 2.0 * SPACING_M)
    heights = np.cumsum(steps)
    heights -= gaussian_filter1d(heights, FALLS_M / 3.0 / SPACING_M)
    return np.asarray(gaussian_filter1d(heights, PATCH_M / SPACING_M))


def under(heights: Array, distance_m: Array) -> Array:
    """Height at distances ridden."""
    return np.asarray(np.interp(distance_m, SPACING_M * np.arange(len(heights)), heights))
