"""Least squares, weighted, and with instruments, with covariances that know of correlated residuals.

Residuals of a filtered record are correlated over 1 / f_c and often longer; counting rows would make
intervals several times too narrow. The covariance is the sandwich (Z'W)^-1 S (W'Z)^-1 with S the long-run
covariance of the moments z_t e_t (Newey and West 1987; Andrews 1991 for the lag) [M], and intervals take
Student's t with the effective number of samples.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hil.errors import IdentificationError
from hil.identify.estimate.regression import Regression

Array = NDArray[np.float64]
LEAST_LAG_S_HZ: Final = 2.5
"""Lags up to this over f_c always count: the filter itself correlates that far."""
FIXED_B: Final = 2.9694 / 1.96
"""What the lag's share of the record adds to a 95 % interval: Kiefer and Vogelsang 2005, Bartlett [M]."""


@dataclass(frozen=True, slots=True)
class LinearFit:
    """p with its covariance; residual (N, n) in N, NaN in rows that did not count."""

    values: Array
    covariance: Array
    residual: Array
    sigma_n: Array
    """(n,) residual standard deviation of each actuator, N."""
    rows: int
    effective: float
    """Number of independent samples that the residuals are worth."""

    @property
    def dof(self) -> float:
        """Degrees of freedom of intervals."""
        return max(self.effective - len(self.values), 3.0)


def solve(problem: Regression, sigma_n: Array, instruments: Regression | None = None) -> LinearFit:
    """p of (Z'W) p = Z'y, rows of actuator i weighed by 1 / sigma_n[i]; Z = W unless `instruments` are given.

    A direction of p that no row sees comes out at the rig file's values, with an infinite variance.
    IdentificationError where nothing moved.
    """
    keep = problem.keep if instruments is None else problem.keep & instruments.keep
    if not keep.any():
        raise IdentificationError(
            "no actuator ever moved: play a motion that moves what is to be identified "
            "(hil experiment)"
        )
    weight = keep / sigma_n
    W = problem.W * weight[:, :, None]
    Z = W if instruments is None else instruments.W * weight[:, :, None]
    scale = problem.scale
    left = problem.y * weight - W @ problem.nominal
    normal = np.einsum("tip,tiq->pq", Z * scale, W * scale)
    U, s, Vt = np.linalg.svd(normal)
    seen = s > 1e-10 * s[0]
    inverse = (Vt[seen].T / s[seen]) @ U[:, seen].T
    step = inverse @ np.einsum("tip,ti->p", Z * scale, left)
    values = problem.nominal + scale * step
    error = (left - W @ (scale * step)) * keep
    moments = np.einsum("tip,ti->tp", Z * scale, error)
    lag = _lag(problem, error)
    S = sum(
        (
            long_run(moments[a:b], lag)
            for a, b in zip(problem.starts, problem.starts[1:], strict=False)
        ),
        np.zeros((len(scale), len(scale))),
    )
    covariance = inverse @ S @ inverse.T
    covariance += 1e16 * Vt[~seen].T @ Vt[~seen]
    rows = int(keep.sum())
    effective = rows / _inflation(problem, error, lag)
    covariance *= effective / max(effective - seen.sum(), 1.0)
    covariance *= (1.0 + FIXED_B * lag / len(error)) ** 2
    residual = np.where(keep, error * sigma_n, np.nan)
    return LinearFit(
        values,
        covariance * np.outer(scale, scale),
        residual,
        _spread(residual, problem.y),
        rows,
        effective,
    )


def ordinary(problem: Regression, instruments: Regression | None = None) -> LinearFit:
    """All rows alike."""
    return solve(problem, np.ones(problem.y.shape[1]), instruments)


def weighted(problem: Regression, instruments: Regression | None = None) -> LinearFit:
    """Rows weighed by their actuator's residual spread in a first ordinary fit."""
    first = ordinary(problem, instruments)
    return solve(problem, first.sigma_n, instruments)


def long_run(moments: Array, lag: int) -> Array:
    """Sum of autocovariances of `moments` (N, P) up to `lag` with Bartlett's weights: positive definite."""
    S: Array = moments.T @ moments
    for k in range(1, min(lag, len(moments) - 1) + 1):
        part = moments[k:].T @ moments[:-k]
        S = S + (1.0 - k / (lag + 1.0)) * (part + part.T)
    return S


def _lag(problem: Regression, error: Array) -> int:
    """Andrews' lag for Bartlett weights from the residuals' AR(1), at least what the filter makes."""
    grid_s = float(np.median(np.diff(problem.prepared[0].t_s)))
    least = int(np.ceil(LEAST_LAG_S_HZ / problem.cutoff_hz / grid_s))
    top = np.sum(error[1:] * error[:-1])
    rho = min(max(float(top / max(np.sum(error**2), 1e-300)), 0.0), 0.97)
    alpha = 4.0 * rho**2 / ((1.0 - rho) ** 2 * (1.0 + rho) ** 2)
    andrews = int(np.ceil(1.1447 * (alpha * len(error)) ** (1.0 / 3.0)))
    return min(max(least, andrews), max(len(error) // 4, 1))


def _inflation(problem: Regression, error: Array, lag: int) -> float:
    """1 + 2 sum of autocorrelations of the residuals: how many rows make one independent sample."""
    total, power = 0.0, 0.0
    for a, b in zip(problem.starts, problem.starts[1:], strict=False):
        for i in range(error.shape[1]):
            e = error[a:b, i : i + 1]
            total += float(long_run(e, lag)[0, 0])
            power += float(np.sum(e**2))
    return max(total / max(power, 1e-300), 1.0)


def _spread(residual: Array, y: Array) -> Array:
    """(n,) standard deviation; a thousandth of the force where too few rows count."""
    counted = np.sum(~np.isnan(residual), axis=0)
    squares = np.nansum(residual**2, axis=0)
    least = 1e-3 * np.sqrt(np.mean(y**2, axis=0)) + 1e-9
    spread: Array = np.where(counted > 10, np.sqrt(squares / np.maximum(counted, 1)), least)
    return spread
