"""What a fit would leave beside further things that may have happened, in the linear picture at the fit."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from hil.gap.fits.fitted import loss, weight

Array = NDArray[np.float64]

TURNS: Final = 4
"""Reweighted steps that make it robust."""


def beside(
    rest: Array, free: Array, nuisances: Array, z: Array, spread: float
) -> tuple[float, Array]:
    """Robust loss of `rest` (N,), whitened and `spread` wide, beside columns `free` (N, F) that may be of any
    size and `nuisances` (N, K) that stand at `z` (K,) deviations of their priors; and the steps (F,)."""
    columns = np.column_stack([free, nuisances])
    own = free.shape[1]
    held = spread**2 * np.diag(np.concatenate([np.zeros(own), np.ones(len(z))]))
    here = np.concatenate([np.zeros(own), z])
    step = np.zeros(columns.shape[1])
    for _ in range(TURNS):
        w = weight((rest - columns @ step) / spread)
        H = columns.T @ (w[:, None] * columns) + held
        # a column that changes nothing takes no step
        step = np.linalg.lstsq(H, columns.T @ (w * rest) - held @ here, rcond=None)[0]
    return float(np.sum(loss((rest - columns @ step) / spread))), step[:own]
