"""The one filter: from samples at their own instants to a signal and its derivatives, without phase.

A cubic smoothing spline [V] minimises sum_k (y_k - x(t_k))^2 + lambda integral x''^2 dt. It is linear in the
samples, needs no common grid, has no phase, and its gain is 1 / (1 + (f / f_c)^4) with
lambda = 1 / (period (2 pi f_c)^4) for samples `period` apart on average. Velocity and acceleration are
its own derivatives, so all three belong together. Every signal of a fit goes through it exactly once with
one f_c: position, force, and the sign of the velocity that stands for Coulomb friction. What the filter
does to the data it thereby does to the model ("What goes wrong": double differences look like compliance,
a causal filter like a delay).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline, make_smoothing_spline

from hil.errors import IdentificationError

Array = NDArray[np.float64]
FEWEST = 20


@dataclass(frozen=True, slots=True)
class ZeroPhaseFilter:
    """Low pass of -6 dB at `cutoff_hz`, no phase."""

    cutoff_hz: float

    def spline(self, t_s: Array, values: Array, what: str) -> BSpline:
        """The smoothed signal (and `derivative()`s) of samples `values` at rising instants `t_s`.

        `what` names the signal in an IdentificationError: too few samples, or too slow for the cutoff.
        """
        if len(t_s) < FEWEST:
            raise IdentificationError(
                f"{what}: has {len(t_s)} samples, {FEWEST} are needed: record longer"
            )
        t, index = np.unique(t_s, return_index=True)
        period_s = float(t[-1] - t[0]) / (len(t) - 1)
        if self.cutoff_hz > 0.4 / period_s:
            raise IdentificationError(
                f"{what}: is sampled {1.0 / period_s:.1f} times a second, too slow for a filter of "
                f"{self.cutoff_hz:g} Hz: ask for at most {0.16 / period_s:.1f} Hz"
            )
        weight = 1.0 / (period_s * (2.0 * np.pi * self.cutoff_hz) ** 4)
        return make_smoothing_spline(t - t[0], values[index], lam=weight)

    @property
    def edge_s(self) -> float:
        """Time at either end in which the spline's ends show."""
        return 0.5 / self.cutoff_hz

    @property
    def grid_s(self) -> float:
        """Period of a grid that keeps what passes the filter."""
        return 0.2 / self.cutoff_hz


def default_cutoff_hz(period_s: float) -> float:
    """A third of the Nyquist frequency of samples `period_s` apart, at most 20 Hz [R]."""
    return min(0.16 / period_s, 20.0)
