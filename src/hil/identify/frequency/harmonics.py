"""Harmonics of a periodic signal by least squares on its true, uneven instants, and its period.

A signal of known period is a sum of harmonics at any instants whatever, so the fit needs no
resampling and nothing leaks from line to line (Pintelon and Schoukens, "System Identification: A
Frequency Domain Approach" [M]). Convention: x(t) = Re Σ_k X_k exp(2πi k (t - start)/period).
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import LinAlgError, cho_factor, cho_solve

from hil.errors import IdentificationError

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

WORST_CONDITION: Final = 0.02
"""Smallest over largest pivot of the normal equations, in squares: below, lines cannot be parted."""
SAME: Final = 1.0e-3
"""A signal repeats where it and itself one period later differ by this share of its deviation."""
FEWEST_SAMPLES: Final = 8
COARSE: Final = 8
"""Every so many samples is enough to see that a lag is none."""


def harmonic_amplitudes(
    t_s: Array, value: Array, start_s: float, period_s: float, count: int, name: str = "signal"
) -> ComplexArray:
    """Complex amplitudes (count + 1,), mean first, over one period from `start_s`.

    IdentificationError where the samples of this period are too few or too uneven for so many lines.
    """
    first, last = np.searchsorted(t_s, [start_s, start_s + period_s])
    angle = 2.0 * np.pi / period_s * (t_s[first:last] - start_s)
    there = f"{name}, {start_s:.3f} to {start_s + period_s:.3f} s"
    if len(angle) < 2 * count + 1:
        raise IdentificationError(
            f"{there}: {len(angle)} samples cannot tell {count} lines; ask for a lower band"
        )
    lines = np.arange(1, count + 1)
    turned = np.outer(angle, lines)
    rows = np.hstack([np.ones((len(angle), 1)), np.cos(turned), -np.sin(turned)])
    try:
        factor = cho_factor(rows.T @ rows, lower=True)
    except LinAlgError:
        factor = None
    pivots = np.zeros(1) if factor is None else np.diag(factor[0]) ** 2
    if factor is None or pivots.min() < WORST_CONDITION * pivots.max():
        gap = float(np.max(np.diff(angle))) * period_s / (2.0 * np.pi)
        raise IdentificationError(
            f"{there}: samples lie too unevenly for {count} lines (longest gap {gap * 1e3:.1f} ms); "
            "ask for a lower band"
        )
    x = cho_solve(factor, rows.T @ value[first:last])
    return np.concatenate([x[:1].astype(complex), x[1 : count + 1] + 1j * x[count + 1 :]])


def waveform(amplitudes: ComplexArray, size: int) -> Array:
    """One period (size,) at even instants from its complex amplitudes (count + 1,)."""
    spectrum = np.zeros(size // 2 + 1, dtype=complex)
    spectrum[: len(amplitudes)] = amplitudes * (0.5 * size)
    spectrum[0] = amplitudes[0].real * size
    return np.asarray(np.fft.irfft(spectrum, size))


def sample_step(t_s: Array) -> float:
    """The step of nearly even samples, some of which may be missing, s: better than any single one."""
    steps = np.diff(t_s)
    whole = np.maximum(np.round(steps / np.median(steps)), 1.0)
    return float(np.sum(steps) / np.sum(whole))


def find_period(t_s: Array, value: Array) -> float | None:
    """The shortest time, s, after which the longest part of a signal repeats; None where none does.

    Where the period is a whole number of sample steps, as with a cue, the answer is exact.
    """
    step = sample_step(t_s)
    x = np.interp(np.arange(t_s[0], t_s[-1] + 0.5 * step, step), t_s, value)
    n = len(x)
    if n < 4 * FEWEST_SAMPLES or np.ptp(x) == 0.0:
        return None
    best: tuple[float, int] | None = None
    for lag in range(FEWEST_SAMPLES, n // 2 + 1):
        share = _repeating(x, lag)
        if share >= 2 * lag and (best is None or share > 1.05 * best[0]):
            best = (share, lag)
    return None if best is None else best[1] * step


def repeating_stretch(t_s: Array, value: Array, period_s: float) -> tuple[float, float] | None:
    """Start and end, s, of the longest part of a signal that repeats with `period_s`; None if none."""
    later = np.interp(t_s + period_s, t_s, value, right=np.nan)
    same = np.abs(later - value) <= _tolerance(value)
    first, last = _longest(same)
    if last <= first:
        return None
    return float(t_s[first]), float(t_s[last - 1] + period_s)


def _tolerance(x: Array) -> float:
    return SAME * float(np.std(x)) + 1e-15


def _repeating(x: Array, lag: int) -> float:
    """Length, in samples, of the longest part of x that repeats after `lag`; standstill does not count."""
    tolerance = _tolerance(x)
    coarse = np.abs(x[lag::COARSE] - x[:-lag:COARSE]) <= tolerance
    if np.mean(coarse) < 0.2:
        return 0.0
    first, last = _longest(np.abs(x[lag:] - x[:-lag]) <= tolerance)
    if last <= first or np.std(x[first : first + lag]) < 0.1 * np.std(x):
        return 0.0
    return float(last - first + lag)


def _longest(mask: NDArray[np.bool_]) -> tuple[int, int]:
    """Start and end of the longest run of True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]])))
    if not len(edges):
        return 0, 0
    starts, ends = edges[::2], edges[1::2]
    k = int(np.argmax(ends - starts))
    return int(starts[k]), int(ends[k])
