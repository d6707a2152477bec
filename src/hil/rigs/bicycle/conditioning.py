"""From measured angles to smooth angles, rates and accelerations, as the text documents it.

Zero-phase Butterworth low-pass (order 2, 5 Hz, run forward and backward), central difference; the rate is
filtered the same way once more before it is differenced again. The same operator must act on whatever is
compared with the result: it takes power out well below its cutoff.

Source: "Validation of multibody modeling and simulation using an instrumented bicycle: from the computer
to the road", section 3.2.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.signal import butter, sosfiltfilt

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Smooth:
    """Lean, rear wheel and steer (N, 3) in this order, with rates and accelerations; rad, s."""

    dt_s: float
    angle: Array
    rate: Array
    acceleration: Array


def low_pass(values: Array, dt_s: float, cutoff_hz: float, order: int = 2) -> Array:
    """Columns of `values` through the Butterworth forward and backward: no delay, gain 1/2 at the cutoff."""
    sections = _sections(order, cutoff_hz, dt_s)
    # the transient dies within two periods of the cutoff; short records are padded by what they have
    pad = min(len(values) - 1, int(2.0 / (cutoff_hz * dt_s)))
    out: Array = sosfiltfilt(sections, values, axis=0, padlen=pad)
    return out


@lru_cache(maxsize=64)
def _sections(order: int, cutoff_hz: float, dt_s: float) -> Array:
    """Designing a filter takes as long as passing a ride through it."""
    return np.asarray(butter(order, cutoff_hz, fs=1.0 / dt_s, output="sos"))


def central(values: Array, dt_s: float) -> Array:
    """Derivative by central differences; one-sided of second order at both ends."""
    out: Array = np.gradient(values, dt_s, axis=0, edge_order=2)
    return out


def smooth(angles: Array, dt_s: float, cutoff_hz: float | None = 5.0, order: int = 2) -> Smooth:
    """Smooth angles (N, 3) sampled every `dt_s`; `cutoff_hz` None differences them as they are."""
    if cutoff_hz is None:
        rate = central(angles, dt_s)
        return Smooth(dt_s, angles, rate, central(rate, dt_s))
    angle = low_pass(angles, dt_s, cutoff_hz, order)
    rate = central(angle, dt_s)
    acceleration = central(low_pass(rate, dt_s, cutoff_hz, order), dt_s)
    return Smooth(dt_s, angle, rate, acceleration)
