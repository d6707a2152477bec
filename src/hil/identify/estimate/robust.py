"""Covariances of a least-squares fit that hold where its residuals are not what they should be.

A twin that lacks something leaves residuals that no autoregression makes white, in step from signal to
signal. So the covariance is the sandwich H^-1 S H^-1 with S the long-run covariance of the scores, all
signals' together in short spans of time (Newey and West 1987; lag by Andrews 1991, formula (6.4) [M]).
And where kinds of signal contradict each other by more than their own scatter, no covariance about their
compromise says so: what stands between them counts as variance of its own, as between the studies of a
meta-analysis (DerSimonian and Laird 1986 [M]).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hil.identify.estimate.linear import FIXED_B, long_run

Array = NDArray[np.float64]
SPAN_S: Final = 0.05
"""Scores of so long are added up before they are correlated, at least: a few samples of each signal."""
MOST_SPANS: Final = 4000
CONTRADICTS: Final = 3.29
"""Standard deviations (99.9 %) between what two kinds of signal say, from which on they contradict."""
TOLD_ALONE: Final = 0.01
"""Share of the whole information below which a kind of signal says nothing of a direction by itself."""


@dataclass(frozen=True, slots=True)
class Contradiction:
    """One parameter (its number): how far from the fit each kind of signal would have it."""

    parameter: int
    steps: Mapping[str, float]


def sandwich(slopes: Array, white: Array, times_s: Array) -> Array:
    """Covariance (P, P) of a fit with residuals `white` (N,) at `times_s` and slopes (N, P).

    No variance is below the textbook's. A time of more than a second without samples ends a record.
    Directions that nothing depends on get 1e16.
    """
    _, s, Vt = np.linalg.svd(slopes, full_matrices=False)
    seen = s > 1e-7 * max(s[0], 1e-300)
    inverse: Array = (Vt[seen].T / s[seen] ** 2) @ Vt[seen]
    plain = inverse * float(white @ white) / max(len(white) - int(seen.sum()), 1)
    robust = inverse @ _scores(slopes * white[:, None], times_s) @ inverse
    least = np.sqrt(np.maximum(np.diag(plain) / np.maximum(np.diag(robust), 1e-300), 1.0))
    covariance: Array = np.outer(least, least) * robust
    covariance += 1e16 * Vt[~seen].T @ Vt[~seen]
    return covariance


def contradictions(
    slopes: Array, white: Array, times_s: Array, kinds: Mapping[str, NDArray[np.bool_]]
) -> tuple[Array, tuple[Contradiction, ...]]:
    """Variance (P,) to add, and which parameters kinds of signal (rows of each) see apart.

    A kind that says nothing of a direction leaves it where the fit has it.
    """
    n = slopes.shape[1]
    more = np.zeros(n)
    if len(kinds) < 2:
        return more, ()
    information = slopes.T @ slopes
    size = np.sqrt(np.maximum(np.diag(information), 1e-300))
    whole = information / np.outer(size, size)
    steps, variances = [], []
    for rows in kinds.values():
        own, left = slopes[rows] / size, white[rows]
        alone = np.linalg.inv(own.T @ own + TOLD_ALONE * (whole + 1e-9 * np.eye(n)))
        scores = own * left[:, None]
        steps.append(-alone @ scores.sum(axis=0) / size)
        S = _scores(scores, times_s[rows])
        variances.append(np.diag(alone @ S @ alone) / size**2)
    step, variance = np.array(steps), np.array(variances)
    weight = 1.0 / np.maximum(variance, 1e-300)
    apart = np.sum(
        weight * (step - np.sum(weight * step, axis=0) / weight.sum(axis=0)) ** 2, axis=0
    )
    spare = len(kinds) - 1
    torn = apart > CONTRADICTS**2 * spare
    room = weight.sum(axis=0) - np.sum(weight**2, axis=0) / weight.sum(axis=0)
    more[torn] = (apart[torn] - spare) / np.maximum(room[torn], 1e-300)
    found = tuple(
        Contradiction(int(k), dict(zip(kinds, step[:, k].tolist(), strict=True)))
        for k in np.flatnonzero(torn)
    )
    return more, found


def _scores(scores: Array, times_s: Array) -> Array:
    """Long-run covariance (P, P) of scores (N, P), records apart."""
    order = np.argsort(times_s, kind="stable")
    at, sorted_scores = times_s[order], scores[order]
    breaks = np.flatnonzero(np.diff(at) > 1.0) + 1
    total_s = float(at[-1] - at[0]) if len(at) else 0.0
    span_s = max(SPAN_S, total_s / MOST_SPANS)
    records = []
    for t, part in zip(np.split(at, breaks), np.split(sorted_scores, breaks), strict=True):
        place = ((t - t[0]) / span_s).astype(np.int64)
        sums = np.zeros((int(place[-1]) + 1, scores.shape[1]))
        np.add.at(sums, place, part)
        records.append(sums)
    count = sum(len(r) for r in records)
    lag = min(_lag(records), max(count // 4, 1))
    S = sum((long_run(r, lag) for r in records), np.zeros((scores.shape[1],) * 2))
    return S * (1.0 + FIXED_B * lag / count) ** 2


def _lag(records: list[Array]) -> int:
    """Andrews' lag for Bartlett's weights from an AR(1) of each parameter's scores."""
    power = sum(np.sum(r**2, axis=0) for r in records)
    next_to = sum(np.sum(r[1:] * r[:-1], axis=0) for r in records)
    rho = np.clip(next_to / np.maximum(power, 1e-300), -0.97, 0.97)[power > 0.0]
    if not len(rho):
        return 0
    alpha = np.sum(4.0 * rho**2 / ((1.0 - rho) ** 6 * (1.0 + rho) ** 2)) / np.sum(
        1.0 / (1.0 - rho) ** 4
    )
    count = sum(len(r) for r in records)
    return int(np.ceil(1.1447 * (float(alpha) * count) ** (1.0 / 3.0)))
