"""The twin with its nuisances refitted: bounded, robust least squares on whitened residuals, with priors.

What a calibration would remove is removed before anything is called a gap, and no more than a calibration
would: nuisances stay within their bounds. Gauss-Newton on difference sensitivities; residuals beyond
HUBER count linearly, so that a gap that is there does not drag the nuisances along; and so many samples
count as one (`Problem.discount`) that nuisances do not follow the small ways in which any twin is wrong.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import lsq_linear

from hil.gap.catalogue.nuisances import LIMIT, Nuisance
from hil.gap.floor.noise import NoiseModel
from hil.gap.record.problem import LATENCY, Problem

Array = NDArray[np.float64]

HUBER: Final = 2.5
ROUNDS: Final = 6
WEIGHT_ROUNDS: Final = 4
"""Reweightings of one linear step."""
SETTLED: Final = 0.05
"""Steps below this share of the priors' spread end the fit."""
WORTH: Final = 0.1
"""Nats of each nuisance that a step must promise where it does not help, for sensitivities to be computed
anew: costs are rugged, and of less nothing comes with new ones either [of seven refits of axes and a Stewart
platform that looked again five were promised less, and got 0.13 nats at most]."""
SHARES: Final = (1.0, 0.5, 0.25)
"""Of a step, that are tried."""
EVEN: Final = (".offset", ".coulomb_friction.force")
"""Endings of nuisances that move alone where no share of a step of all helps: costs are rugged in time, and
what is the same at every instant but for a sign can neither wait for it nor make up for it. A mass would."""
TINY: Final = 1e-6
"""Prior spreads that what is held may move, for a solver whose bounds must differ."""
NEARBY: Final = 0.3
"""Of a latency's prior, how far its sensitivity is stepped."""


@dataclass(frozen=True, slots=True)
class Fitted:
    """One nuisance after the refit: how far it went from the rig file's value."""

    name: str
    unit: str
    change: float
    sd: float
    """Of the estimate, given the floor."""
    prior_sd: float
    at_bound: bool


@dataclass(frozen=True, slots=True)
class Refit:
    """The twin as near to the record as calibration brings it."""

    vector: Array
    """(P of the table,)."""
    residual: Array
    """(N,) measured minus twin, in the signals' units."""
    jacobian: Array
    """(N, K) sensitivities to the K nuisances, in the order of `fitted`."""
    fitted: tuple[Fitted, ...]

    @property
    def prior_sd(self) -> Array:
        """(K,)."""
        return np.array([f.prior_sd for f in self.fitted])


def refit(
    problem: Problem,
    noise: NoiseModel,
    nuisances: Sequence[Nuisance],
    start: Array | None = None,
    jacobian: Array | None = None,
) -> Refit:
    """Fit `nuisances` from `start` (default: where they are thought to be), each within LIMIT of its prior.

    Priors are centred on the rig file's values plus their own means, whatever `start` is. `jacobian`
    (N, K): sensitivities known from a nearby point, computed anew only where steps by them stop to help.
    """
    names = [n.name for n in nuisances]
    sd = np.array([n.sd for n in nuisances])
    index = [problem.table.index(n.name) for n in nuisances]
    centre = problem.base[index] + np.array([n.mean for n in nuisances])
    lower, upper = reach(problem, nuisances)
    vector = expected(problem, nuisances) if start is None else np.array(start)
    z = np.clip((vector[index] - centre) / sd, lower, upper)
    vector[index] = centre + sd * z
    residual = problem.residual(vector)
    if not names:
        return Refit(vector, residual, np.zeros((problem.size, 0)), ())
    given = jacobian
    fresh = given is None
    J = given if given is not None else nuisance_sensitivities(problem, nuisances, vector, residual)
    information = np.eye(len(z))

    def towards(there: Array, here: float) -> tuple[Array, Array, Array] | None:
        """Parameters, residual, nuisances by the largest share of a step that costs less than `here`."""
        for share in SHARES:
            new = z + share * (there - z)
            trial = _moved(problem, nuisances, vector, sd * (new - z))
            left = problem.residual(trial)
            if cost(noise.whiten(problem, left), new, problem.discount) < here:
                return trial, left, new
        return None

    varied = np.array([not n.name.endswith(EVEN) for n in nuisances])
    for _ in range(ROUNDS):
        white, slopes = noise.whiten(problem, residual), noise.whiten(problem, J) * sd
        target, information = _step(slopes, white, z, lower, upper, problem.discount)
        way, here, moved = target - z, cost(white, z, problem.discount), 0.0
        step = towards(target, here)
        if step is None and np.max(np.abs(way)) >= SETTLED and not varied.all():
            low, high = np.where(varied, z - TINY, lower), np.where(varied, z + TINY, upper)
            step = towards(_step(slopes, white, z, low, high, problem.discount)[0], here)
        if step is not None:
            moved = float(np.max(np.abs(step[2] - z)))
            vector, residual, z = step
        if moved >= SETTLED:
            continue
        promised = here - cost(white - slopes @ way, target, problem.discount)
        if fresh or np.max(np.abs(way)) < SETTLED or promised < WORTH * len(z):
            break
        J, fresh = nuisance_sensitivities(problem, nuisances, vector, residual), True
    spread = np.sqrt(np.diag(np.linalg.inv(information)))
    fitted = tuple(
        Fitted(n.name, n.unit, float(n.mean + n.sd * z[k]), float(n.sd * spread[k]), n.sd,
               bool(min(z[k] - lower[k], upper[k] - z[k]) < 1e-3))
        for k, n in enumerate(nuisances)
    )  # fmt: skip
    return Refit(vector, residual, J, fitted)


def total(
    problem: Problem, noise: NoiseModel, nuisances: Sequence[Nuisance], found: Refit
) -> float:
    """Nats of what a refit of `nuisances` leaves and of what their priors cost."""
    z = deviations(found, nuisances)
    return cost(noise.whiten(problem, found.residual), z, problem.discount)


def deviations(found: Refit, nuisances: Sequence[Nuisance]) -> Array:
    """(K,) of a refit of `nuisances` from where they were thought to be, in spreads of their priors."""
    moved = zip(found.fitted, nuisances, strict=True)
    return np.array([(f.change - n.mean) / n.sd for f, n in moved])


def reach(problem: Problem, nuisances: Sequence[Nuisance]) -> tuple[Array, Array]:
    """(K,) how far nuisances may go, in their deviations from where they are thought to be: LIMIT, or where
    the parameter itself ends."""
    sd = np.array([n.sd for n in nuisances])
    entries = [problem.table[n.name] for n in nuisances]
    centre = expected(problem, nuisances)[[problem.table.index(n.name) for n in nuisances]]
    lower = (np.array([p.lower for p in entries]) - centre) / sd
    upper = (np.array([p.upper for p in entries]) - centre) / sd
    return np.maximum(lower, -LIMIT), np.minimum(upper, LIMIT)


def expected(problem: Problem, nuisances: Sequence[Nuisance]) -> Array:
    """(P,) the rig file's own parameters, with the nuisances where they are thought to be."""
    vector = np.array(problem.base)
    for n in nuisances:
        vector[problem.table.index(n.name)] += n.mean
    return vector


def nuisance_sensitivities(
    problem: Problem, nuisances: Sequence[Nuisance], vector: Array, residual: Array
) -> Array:
    """(N, K) of the prediction to each nuisance, at `vector`, which leaves `residual`.

    A latency is stepped by NEARBY of its prior: forces jump at each setpoint, and over a tick's delay a
    sample next to a jump says nothing of what it does nearby.
    """
    most = [NEARBY * n.sd if n.name.endswith(LATENCY) else np.inf for n in nuisances]
    names = [n.name for n in nuisances]
    return problem.jacobian(names, vector, problem.measured - residual, most)


def _moved(problem: Problem, nuisances: Sequence[Nuisance], vector: Array, steps: Array) -> Array:
    """`vector` with each nuisance moved by its step."""
    out = np.array(vector)
    for n, step in zip(nuisances, steps, strict=True):
        out[problem.table.index(n.name)] += step
    return out


def counted(white: Array) -> Array:
    """What each whitened residual counts: those beyond HUBER as much as one there."""
    return np.asarray(np.minimum(1.0, HUBER / np.maximum(np.abs(white), 1e-12)))


def _step(
    J: Array, white: Array, z: Array, lower: Array, upper: Array, discount: float
) -> tuple[Array, Array]:
    """Where the linear problem has its bounded robust minimum, and its information matrix there."""
    new = np.array(z)
    information = np.eye(len(z))
    for _ in range(WEIGHT_ROUNDS):
        weighted = J * counted(white - J @ (new - z))[:, None]
        information = weighted.T @ J / discount + np.eye(len(z))
        gradient = weighted.T @ (white + J @ z) / discount
        root = np.linalg.cholesky(information)
        aim = np.linalg.solve(root, gradient)
        new = np.asarray(lsq_linear(root.T, aim, (lower, upper), method="bvls").x)
    return new, information


def cost(white: Array, z: Array, discount: float) -> float:
    """What a refit minimises, in nats: of whitened residuals (N,) and nuisances z (K,) in prior spreads."""
    size = np.abs(white)
    huber = np.where(size <= HUBER, 0.5 * size**2, HUBER * (size - 0.5 * HUBER))
    return float(np.sum(huber) / discount + 0.5 * z @ z)
