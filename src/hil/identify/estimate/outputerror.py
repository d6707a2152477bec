"""Least squares through the twin, with residuals made white, and the profile of any one parameter.

Each signal's residuals are divided by their own spread and run through the inverse of their own
autoregression (Cochrane and Orcutt), so that what is minimised is nearly independent where the model is
right (Ljung, System Identification, ch. 9) [M]; `robust` sees to intervals that hold where it is not.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_toeplitz
from scipy.signal import lfilter

from hil.errors import IdentificationError
from hil.identify.estimate.robust import contradictions, sandwich
from hil.identify.estimate.twinproblem import TwinProblem

Array = NDArray[np.float64]
ORDER: Final = 8
"""Most terms of a residual's autoregression."""
DETERIORATES: Final = 1.2
"""Where whitening makes any signal's residual so much larger, what it whitened was no noise but something
that the model lacks, and whitening gave the say to where that is worst: residuals count as they are [R]."""
STEPS: Final = 8
SHARES: Final = (1.0, 0.5, 0.2, 0.05)
"""Parts of a Gauss-Newton step that are tried side by side."""
SETTLED: Final = 0.1
"""A step below this share of a parameter's standard deviation ends the search."""


@dataclass(frozen=True, slots=True)
class NoiseModel:
    """Spread and autoregression of each signal's residuals, in the order of the problem's signals."""

    sigma: tuple[float, ...]
    ar: tuple[Array, ...]

    def whiten(self, problem: TwinProblem, flat: Array) -> Array:
        """(N, ...) residuals or sensitivities as they count."""
        out = np.empty_like(flat)
        for (_, part), sigma, ar in zip(problem.signals, self.sigma, self.ar, strict=True):
            out[part] = lfilter(np.concatenate([[1.0], -ar]), [1.0], flat[part] / sigma, axis=0)
        return out


@dataclass(frozen=True, slots=True)
class OutputErrorFit:
    """Parameters (P,), their covariance, residuals (N,) in the signals' units."""

    values: Array
    covariance: Array
    residual: Array
    noise: NoiseModel
    white: Array
    """(N,) residuals as they count: independent, near 1."""
    jacobian: Array
    """(N, P) sensitivities, whitened."""
    at_bound: tuple[str, ...]
    torn: Mapping[str, Mapping[str, float]]
    """By parameter of which kinds of signal contradict each other: what each kind says for itself."""

    @property
    def cost(self) -> float:
        """Half the sum of squares of `white`."""
        return 0.5 * float(self.white @ self.white)

    @property
    def dof(self) -> float:
        """Degrees of freedom of intervals."""
        return float(len(self.white) - len(self.values))


def fit(problem: TwinProblem, start: Array | None = None) -> OutputErrorFit:
    """Fit from `start` (default: the rig file). IdentificationError where the twin cannot follow the data."""
    lower, upper = problem.bounds
    values = np.clip(problem.start if start is None else start, lower, upper)
    first = _minimise(problem, values, _first_noise(problem))
    residual = _residual(problem, first)
    noise = noise_of(problem, residual)
    values = _minimise(problem, first, noise)
    white = _residual(problem, values)
    spread, own = _spreads(problem, white), _spreads(problem, residual)
    if np.any(spread > DETERIORATES * own):
        plain = noise_of(problem, residual, 0)
        values = _minimise(problem, first, plain)
        return at(problem, values, noise_of(problem, _residual(problem, values), 0))
    return at(problem, values, noise_of(problem, white))


def _spreads(problem: TwinProblem, residual: Array) -> Array:
    """Root mean square of each signal's residual, not below its noise."""
    return np.array(
        [
            max(float(np.sqrt(np.mean(residual[part] ** 2))), expected_noise(problem, name))
            for name, part in problem.signals
        ]
    )


def at(problem: TwinProblem, values: Array, noise: NoiseModel) -> OutputErrorFit:
    """Everything about the point `values` of a problem under a noise model."""
    lower, upper = problem.bounds
    residual = _residual(problem, values)
    white = noise.whiten(problem, residual)
    slopes = noise.whiten(problem, problem.jacobian(values))
    scale = problem.scale
    covariance = sandwich(slopes * scale, white, problem.times_s)
    more, found = contradictions(slopes * scale, white, problem.times_s, problem.kinds)
    covariance = (covariance + np.diag(more)) * np.outer(scale, scale)
    torn = {
        problem.names[c.parameter]: {
            kind: float(values[c.parameter] + scale[c.parameter] * step)
            for kind, step in c.steps.items()
        }
        for c in found
    }
    near = (np.abs(values - lower) < 1e-6 * scale) | (np.abs(values - upper) < 1e-6 * scale)
    stuck = tuple(n for n, x in zip(problem.names, near, strict=True) if x)
    return OutputErrorFit(values, covariance, residual, noise, white, slopes, stuck, torn)


def noise_of(problem: TwinProblem, residual: Array, most_terms: int = ORDER) -> NoiseModel:
    """Spread and autoregression of residuals; terms are kept while they are clear of chance."""
    sigmas, terms = [], []
    for name, part in problem.signals:
        e = residual[part]
        sigma = max(float(np.sqrt(np.mean(e**2))), 0.1 * expected_noise(problem, name))
        order = min(most_terms, len(e) // 20)
        ar = np.empty(0)
        if order:
            r = np.array([e[k:] @ e[: len(e) - k] for k in range(order + 1)]) / len(e)
            if np.any(np.abs(r[1:]) > 3.0 * r[0] / np.sqrt(len(e))):
                ar = np.asarray(
                    solve_toeplitz(r[:-1] + 1e-9 * r[0] * (np.arange(order) == 0), r[1:])
                )
                power = float(r[0] - ar @ r[1:])
                sigma = max(float(np.sqrt(max(power, 0.0))), 0.1 * expected_noise(problem, name))
        sigmas.append(sigma)
        terms.append(ar)
    return NoiseModel(tuple(sigmas), tuple(terms))


@dataclass(frozen=True, slots=True)
class Profile:
    """Cost of the best fit at fixed values of one parameter."""

    name: str
    values: Array
    """(G,)"""
    rise: Array
    """(G,) rise of -2 log likelihood over the best: below 3.84 within 95 %."""
    others: Array
    """(G, P) parameters of the best fit at each value."""


def profile(
    problem: TwinProblem, best: OutputErrorFit, name: str, values: Sequence[float]
) -> Profile:
    """Profile likelihood of parameter `name` over `values`, all others refitted, noise model of `best`."""
    k = problem.names.index(name)
    variance = 2.0 * best.cost / best.dof
    found = np.empty((len(values), len(problem.names)))
    cost = np.empty(len(values))
    free = [i for i in range(len(problem.names)) if i != k]
    for g, fixed in enumerate(values):
        start = np.array(best.values)
        start[k] = fixed
        # along the ridge: what the others do to make up for the step
        step, *_ = np.linalg.lstsq(
            best.jacobian[:, free] * problem.scale[free],
            -best.jacobian[:, k] * (fixed - best.values[k]),
            rcond=1e-9,
        )
        start[free] += np.clip(step, -1.0, 1.0) * problem.scale[free]
        found[g] = _minimise(problem, np.clip(start, *problem.bounds), best.noise, fixed=k)
        white = best.noise.whiten(problem, _residual(problem, found[g]))
        cost[g] = float(white @ white)
    return Profile(name, np.array(values), (cost - 2.0 * best.cost) / variance, found)


def _minimise(
    problem: TwinProblem, start: Array, noise: NoiseModel, fixed: int | None = None
) -> Array:
    """Gauss-Newton with a parallel line search, until a step is small against its own uncertainty."""
    free = np.array([i for i in range(len(start)) if i != fixed], dtype=int)
    scale = problem.scale
    lower, upper = problem.bounds
    values = np.array(start)
    residual = noise.whiten(problem, _residual(problem, values))
    for _ in range(STEPS if len(free) else 0):
        slopes = noise.whiten(problem, problem.jacobian(values))[:, free] * scale[free]
        step, deviation = _step(slopes, residual)
        pushes = ((values[free] <= lower[free]) & (step < 0.0)) | (
            (values[free] >= upper[free]) & (step > 0.0)
        )
        if pushes.any():  # what presses against a bound stays there
            slopes[:, pushes] = 0.0
            step, deviation = _step(slopes, residual)
        if np.all(np.abs(step) < SETTLED * deviation):
            break
        step = step / max(1.0, float(np.abs(step).max()))
        rows = np.tile(values, (len(SHARES), 1))
        rows[:, free] += np.outer(SHARES, step * scale[free])
        rows = np.clip(rows, lower, upper)
        errors = [noise.whiten(problem, flat - problem.measured) for flat in problem.predict(rows)]
        costs = [float(e @ e) if np.all(np.isfinite(e)) else np.inf for e in errors]
        best = int(np.argmin(costs))
        if not costs[best] < float(residual @ residual):
            break
        values, residual = rows[best], errors[best]
    return values


def _step(slopes: Array, residual: Array) -> tuple[Array, Array]:
    """(step, its standard deviation), both in scales; directions that nothing depends on stay."""
    U, s, Vt = np.linalg.svd(slopes, full_matrices=False)
    seen = s > 1e-7 * max(float(s[0]), 1e-300)
    step = -Vt[seen].T @ ((U[:, seen].T @ residual) / s[seen])
    variance = float(residual @ residual) / len(residual)
    deviation = np.sqrt(variance * np.sum((Vt[seen].T / s[seen]) ** 2, axis=1)) + 1e-9
    return step, deviation


def _residual(problem: TwinProblem, values: Array) -> Array:
    error: Array = problem.predict(values[None, :])[0] - problem.measured
    if not np.all(np.isfinite(error)):
        raise IdentificationError(
            f"{problem.rig.name}: the twin cannot stand where the run began: is it the rig file of the "
            "rig that ran?"
        )
    return error


def _first_noise(problem: TwinProblem) -> NoiseModel:
    sigma = tuple(expected_noise(problem, name) for name, _ in problem.signals)
    return NoiseModel(sigma, tuple(np.empty(0) for _ in sigma))


def expected_noise(problem: TwinProblem, signal: str) -> float:
    """The rig file's noise of a signal, quantisation included."""
    place, _, quantity = signal.rpartition(".")
    kind = quantity.partition("_")[0] if place == "imu" else quantity
    noise = problem.rig.noise
    own = float(getattr(noise, kind))
    return float(np.hypot(own, getattr(noise, f"{kind}_step") / np.sqrt(12.0))) or 1e-9
