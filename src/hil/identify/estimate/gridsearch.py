"""Grid search in stages with local refinement: no local minimum is missed, and ridges show themselves.

"Towards Simulating a Mid-size Stewart Platform on a Large Hexapod Simulator", section F: first what slow
translation shows (m_c, x_cog, y_cog, K_c from the circle), then what rotation shows (z_cog and the moments
of inertia, one sweep at a time), each by a grid over its bounds.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hil.errors import ConfigError
from hil.identify.estimate.outputerror import NoiseModel, OutputErrorFit, at, fit, noise_of
from hil.identify.estimate.twinproblem import TwinProblem

Array = NDArray[np.float64]
MOST: Final = 5000
"""Points of one grid."""
ALIKE: Final = 3.84
"""Rise of -2 log likelihood below which two points cannot be told apart (95 %, one parameter)."""


@dataclass(frozen=True, slots=True)
class GridResult:
    """All points of the finest grid, and the fit that a local search made of the best."""

    points: Array
    """(G, P)"""
    rise: Array
    """(G,) -2 log likelihood over the best point's, by the effective noise at that point."""
    best: OutputErrorFit

    @property
    def alike(self) -> Array:
        """(A, P) points that these data cannot tell from the best one: a ridge, where they lie far apart."""
        return self.points[self.rise < ALIKE]


def grid_search(
    problem: TwinProblem,
    axes: Mapping[str, tuple[float, float, int]],
    *,
    rounds: int = 2,
    refine: bool = True,
) -> GridResult:
    """Search parameters `axes` (name: lowest, highest, points), others at the rig file's values.

    Each round halves every span about the best point. `refine`: then a local fit of all parameters.
    """
    unknown = [n for n in axes if n not in problem.names]
    for name, (lowest, highest, count) in axes.items():
        if not (-math.inf < lowest <= highest < math.inf and count > 0):
            raise ConfigError(
                f"{problem.rig.name}: grid over {name}: {lowest:g} to {highest:g} in {count} points: needs "
                "two finite numbers, the lowest first, and one point or more"
            )
    size = math.prod(k for _, _, k in axes.values())
    if unknown or size > MOST or size < 2:
        raise ConfigError(
            f"{problem.rig.name}: a grid of {size} points over {', '.join(axes)}: at most {MOST} points, "
            f"over parameters that are fitted{' (not ' + ', '.join(unknown) + ')' if unknown else ''}"
        )
    spans = {n: (float(a), float(b)) for n, (a, b, _) in axes.items()}
    columns = [problem.names.index(n) for n in axes]
    centre = problem.start
    for _ in range(max(rounds, 1)):
        lines = [np.linspace(*spans[n], axes[n][2]) for n in axes]
        points = np.tile(centre, (size, 1))
        points[:, columns] = list(itertools.product(*lines))
        flat = problem.predict(points)
        noise = _noise_of_best(problem, flat)
        errors = [noise.whiten(problem, row - problem.measured) for row in flat]
        cost = np.array([e @ e if np.all(np.isfinite(e)) else np.inf for e in errors])
        centre = points[int(np.argmin(cost))]
        for n, k in zip(axes, columns, strict=True):
            half = 0.25 * (spans[n][1] - spans[n][0])
            lower, upper = (b[k] for b in problem.bounds)
            middle = float(np.clip(centre[k], lower + half, max(upper - half, lower + half)))
            spans[n] = (max(middle - half, lower), min(middle + half, upper))
    variance = float(cost.min()) / len(problem.measured)
    rise = (cost - cost.min()) / max(variance, 1e-300)
    best = fit(problem, centre) if refine else at(problem, centre, noise)
    return GridResult(points, rise, best)


def _noise_of_best(problem: TwinProblem, flat: Array) -> NoiseModel:
    """Noise model at the point whose residuals are smallest against the rig file's noise."""
    from_file = NoiseModel(
        tuple(max(float(np.std(problem.measured[p])), 1e-12) for _, p in problem.signals),
        tuple(np.empty(0) for _ in problem.signals),
    )
    errors = [from_file.whiten(problem, row - problem.measured) for row in flat]
    cost = [float(e @ e) if np.all(np.isfinite(e)) else np.inf for e in errors]
    return noise_of(problem, flat[int(np.argmin(cost))] - problem.measured)
