"""What fits start from, the calibrated twin, and what they come to, with the robust loss that both know."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hil.gap.catalogue.nuisances import Nuisance
from hil.gap.floor.noise import NoiseModel
from hil.gap.located.residual import Refit
from hil.gap.record.leaf import Leaf
from hil.gap.record.problem import Mask, Problem

Array = NDArray[np.float64]

FREEDOM: Final = 4.0
"""Of Student's distribution: residuals have the tails of frames that just missed a tick."""


@dataclass(frozen=True)
class Calibrated:
    """The twin as calibration left it, whitened once for all fits; K nuisances."""

    problem: Problem
    noise: NoiseModel
    nuisances: tuple[Nuisance, ...]
    vector: Array
    residual: Array
    white: Array
    """(N,) the residual whitened."""
    jacobian: Array
    """(N, K) whitened, per prior standard deviation."""
    z: Array
    """(K,) where the nuisances stand, in prior standard deviations."""
    train: Mask
    """(N,) samples that are judged."""

    @cached_property
    def floors(self) -> dict[str, float]:
        """By signal, the weighted root mean square of what no gap leaves."""
        return self.noise.weighted_rms(self.problem, self.noise.draws)

    @cached_property
    def usual_floors(self) -> dict[str, float]:
        """By signal, the same of the usual samples."""
        return self.noise.usual(self.problem, self.noise.draws)

    @cached_property
    def drawn(self) -> Array:
        """(D,) robust loss of each draw of what no gap leaves."""
        white = (self.noise.whiten(self.problem, row)[self.train] for row in self.noise.draws)
        return np.array([np.sum(loss(w)) for w in white])


@dataclass(frozen=True, slots=True)
class Fit:
    """Candidates with the parameters that fit best."""

    leaves: tuple[Leaf, ...]
    names: tuple[str, ...]
    """(P,) parameters that were moved."""
    values: Array
    """(P,)."""
    search_sd: Array
    """(P,) standard deviation of each in its search coordinate, given independent noise of spread 1."""
    vector: Array
    residual: Array
    white: Array
    z: Array
    """(K,) nuisances."""
    at_bound: tuple[str, ...]
    extra_cost: float = 0.0
    """Nats of freedom that is in no parameter, such as which frames were lost."""

    def cost(self, train: Mask) -> float:
        """Robust half sum of squares over `train` samples."""
        return float(np.sum(loss(self.white[train])))

    def total(self, c: Calibrated) -> float:
        """What is minimised: that, and what the nuisances' priors cost beside so many samples."""
        return self.cost(c.train) + c.problem.discount * self.prior_cost

    @property
    def prior_cost(self) -> float:
        """What the nuisances' priors cost."""
        return float(0.5 * self.z @ self.z)

    def is_of(self, leaves: Sequence[Leaf]) -> bool:
        """Whether `leaves`, in whatever order, are its candidates."""
        return len(leaves) == len(self.leaves) and all(x in leaves for x in self.leaves)


def loss(white: Array) -> Array:
    """Half squares that grow ever slower: minus the log of Student's distribution with FREEDOM."""
    return np.asarray(0.5 * (FREEDOM + 1.0) * np.log1p(white**2 / FREEDOM))


def weight(white: Array) -> Array:
    """What a sample counts in `loss`, 1 where it is small."""
    return np.asarray((FREEDOM + 1.0) / (FREEDOM + white**2))


def calibrated(
    problem: Problem,
    noise: NoiseModel,
    nuisances: Sequence[Nuisance],
    best: Refit,
) -> Calibrated:
    """What fits start from."""
    sd = np.array([n.sd for n in nuisances])
    mean = np.array([n.mean for n in nuisances])
    index = [problem.table.index(n.name) for n in nuisances]
    z = (best.vector[index] - problem.base[index] - mean) / sd
    return Calibrated(
        problem, noise, tuple(nuisances), best.vector, best.residual,
        noise.whiten(problem, best.residual),
        noise.whiten(problem, best.jacobian) * sd, z, problem.kept,
    )  # fmt: skip


def spread_of(c: Calibrated, white: Array) -> float:
    """Of a whitened residual, at least 1: the robust loss is widened to it while a fit is far from the data,
    where it would be flat."""
    return max(1.0, 1.4826 * float(np.median(np.abs(white[c.train]))))


def replay_cost(c: Calibrated, answer: Array, spread: float = 1.0) -> float:
    """Robust loss, `spread` wide, that a replay's answer (N,) leaves; infinite if the twin cannot stand."""
    if not np.all(np.isfinite(answer)):
        return np.inf
    white = c.noise.whiten(c.problem, c.problem.measured - answer)[c.train]
    return float(np.sum(loss(white / spread)))
