"""A residual taken apart into frequency bands that add up to it, energies included.

A cosine transform of the whole stretch (even continuation, so that ends make no jump), cut into bands:
the parts are orthogonal over the stretch (Parseval), unlike those of filters that overlap. Each sample
keeps its place, so energy can still be counted by time and region.
"""

from __future__ import annotations

import itertools
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.fft import dct, idct

Array = NDArray[np.float64]

EDGES_HZ: Final = (0.1, 0.3, 1.0, 3.0, 10.0, 30.0, 100.0, 300.0, 1000.0)
"""Half-decades; the first band reaches down to the mean, the last of a signal up to its Nyquist frequency."""


def bands_hz(step_s: float) -> tuple[tuple[float, float], ...]:
    """The bands of a signal sampled every `step_s`."""
    nyquist = 0.5 / step_s
    inner = [f for f in EDGES_HZ if f < 0.8 * nyquist]
    edges = [0.0, *inner, nyquist]
    return tuple(itertools.pairwise(edges))


def split_bands(t_s: Array, rows: Array, step_s: float) -> Array:
    """(..., N) samples at t_s (N,) into (K, ..., N) parts by `bands_hz(step_s)` that add up to `rows`.

    Samples count as evenly spaced `step_s` apart (jitter of stamps is small beside that); where samples
    are missing the record is bridged by straight lines, which are not handed back.
    """
    steps = np.maximum(np.round(np.diff(t_s) / step_s), 1.0).astype(np.int64)
    place = np.concatenate([[0], np.cumsum(steps)])
    n = int(place[-1]) + 1
    full = rows
    if n != rows.shape[-1]:
        grid = np.arange(n)
        flat = rows.reshape(-1, rows.shape[-1])
        full = np.array([np.interp(grid, place, r) for r in flat]).reshape(*rows.shape[:-1], n)
    spectrum = dct(full, type=2, norm="ortho", axis=-1)
    hz = np.arange(n) / (2.0 * n * step_s)
    out = []
    bands = bands_hz(step_s)
    for k, (low, high) in enumerate(bands):
        inside = (hz >= low) & ((hz < high) | (k == len(bands) - 1))
        part = idct(np.where(inside, spectrum, 0.0), type=2, norm="ortho", axis=-1)
        out.append(part[..., place])
    return np.array(out)
