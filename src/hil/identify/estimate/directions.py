"""What these data can tell: singular directions of a fit's information, in names.

With parameters measured in their scales and residuals in their noise, an eigenvector of the covariance is a
combination of parameters and its eigenvalue how well the data tell it. A combination is untold
where its standard deviation is as large as the parameters themselves.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
UNTOLD: Final = 0.5
"""Standard deviation of a direction, in scales, from which on it counts as untold [R]."""
PART: Final = 0.15
"""Share from which on a parameter is named in a direction."""


@dataclass(frozen=True, slots=True)
class Direction:
    """A combination sum_k parts[k] (p_k / scale_k) of parameters and its standard deviation."""

    parts: dict[str, float]
    deviation: float
    """In scales of the parameters; infinite where the data do not see it at all."""

    @property
    def text(self) -> str:
        """Such as "0.71 mass.m + 0.71 all.force_gain", each in units of its scale."""
        terms = sorted(self.parts.items(), key=lambda item: -abs(item[1]))
        return " ".join(f"{x:+.2f} {name}" for name, x in terms).removeprefix("+")


@dataclass(frozen=True, slots=True)
class Analysis:
    """Rank and condition of a problem, and the directions that its data leave open."""

    rank: int
    condition: float
    """Largest over smallest singular value of the determined directions' information."""
    untold: tuple[Direction, ...]
    """Worst first."""

    def about(self, name: str) -> Direction | None:
        """The untold direction in which `name` has the largest part, if any."""
        having = [d for d in self.untold if name in d.parts]
        return max(having, key=lambda d: abs(d.parts[name]), default=None)


def analyse(names: Sequence[str], covariance: Array, scale: Array) -> Analysis:
    """Directions of a covariance (P, P) of parameters `names` with sizes `scale` (P,)."""
    relative = covariance / np.outer(scale, scale)
    variances, vectors = np.linalg.eigh(0.5 * (relative + relative.T))
    deviations = np.sqrt(np.maximum(variances, 0.0))
    told = deviations < UNTOLD
    untold = [
        _direction(names, vectors[:, k], float(deviations[k]))
        for k in range(len(names) - 1, -1, -1)
        if not told[k]
    ]
    good = deviations[told]
    condition = float(good[-1] / max(good[0], 1e-300)) if len(good) else float("inf")
    return Analysis(int(told.sum()), condition, tuple(untold))


def _direction(names: Sequence[str], vector: Array, deviation: float) -> Direction:
    vector = vector * np.sign(vector[int(np.argmax(np.abs(vector)))])
    parts = {n: float(x) for n, x in zip(names, vector, strict=True) if abs(x) >= PART}
    return Direction(parts, float("inf") if deviation > 1e6 else deviation)
