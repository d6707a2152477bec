"""How noisy each line of a response is, told by all lines together.

Two periods leave one degree of freedom a line: some lines then look sure by luck, and a fit that believes
them is wrong by more than its interval (95 % held 86 %).
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq
from scipy.special import digamma, polygamma

from hil.identify.frequency.response import FrequencyResponse

Array = NDArray[np.float64]

FEWEST: Final = 4
"""Lines from which on they say anything about each other."""
FEWEST_SLOPED: Final = 6
"""And from which on noise may rise or fall with frequency."""
LARGEST_FREEDOM: Final = 1.0e3
"""Degrees of freedom of what lines have in common, where they differ by no more than chance."""


def steadied(response: FrequencyResponse) -> Array:
    """Standard deviations (F,) of the lines, each drawn towards what all lines say of noise.

    A straight line in log f stands for how the logarithm of the variance goes with frequency; how far lines
    really differ from it is estimated from their scatter, so that they keep their own where they do
    (Smyth, "Linear models and empirical Bayes methods for assessing differential expression in microarray
    experiments", 2004 [M]).
    """
    std = response.std.copy()
    there = std > 0.0
    if there.sum() < FEWEST:
        return std
    own, freedom = std[there] ** 2, 2.0 * response.freedom[there]
    # The logarithm of an estimated variance is off by, and scatters by, what its freedom says.
    level = np.log(own) - digamma(0.5 * freedom) + np.log(0.5 * freedom)
    scatter = polygamma(1, 0.5 * freedom)
    rows = np.stack([np.ones(len(own)), np.log(response.hz[there])], axis=1)
    rows = rows[:, : 2 if len(own) >= FEWEST_SLOPED else 1]
    weight = 1.0 / np.sqrt(scatter)
    trend = rows @ np.linalg.lstsq(rows * weight[:, None], level * weight)[0]
    excess = float(np.sum((level - trend) ** 2)) / (len(own) - rows.shape[1]) - float(
        np.mean(scatter)
    )
    common = _freedom_of(excess)
    usual = np.exp(trend + digamma(0.5 * common) - np.log(0.5 * common))
    std[there] = np.sqrt((common * usual + freedom * own) / (common + freedom))
    return std


def _freedom_of(scatter: float) -> float:
    """Degrees of freedom with which the logarithm of a variance scatters so (a variance itself)."""
    if scatter <= polygamma(1, 0.5 * LARGEST_FREEDOM):
        return LARGEST_FREEDOM
    return 2.0 * float(brentq(lambda x: polygamma(1, x) - scatter, 1e-3, LARGEST_FREEDOM))
