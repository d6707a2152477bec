"""How much of the gap stands and how much a fit takes away, in floors of the signals and as a share."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hil.gap.fit import Calibrated, Fit
from hil.gap.problem import Problem
from hil.gap.result import Located

Array = NDArray[np.float64]

FAINT: Final = 0.3
"""Squared floors of energy above the floor that are too few to speak of."""


def weighed_ratio(located: Located) -> float:
    """Largest usual residual of a signal over its floor."""
    e = located.evidence
    left = e.noise.usual(e.problem, e.residual)
    floors = e.noise.usual(e.problem, e.noise.draws)
    return max(left[s] / floors[s] for s in left if floors[s] > 0.0)


def largest_ratio(c: Calibrated, f: Fit) -> float:
    """Largest usual residual of a signal on training samples, in its floor."""
    left = c.noise.usual(c.problem, f.residual)
    floors = c.noise.usual(c.problem, c.noise.draws)
    return max(left[s] / floors[s] for s in left if floors[s] > 0.0)


def explained(c: Calibrated, none: Fit, f: Fit) -> float:
    """Share of the gap's energy above the floor that a fit takes away on training samples, 0..1.

    Lone spikes are cut as everywhere; where nothing stands above the floor without them, they are the gap.
    """
    was, left = _above(c, none, f, c.noise.weighted_rms)
    if was < FAINT:
        was, left = _above(c, none, f, _with_spikes(c))
    return float(np.clip((was - left) / max(was, 0.05), 0.0, 1.0))


def _above(
    c: Calibrated, none: Fit, f: Fit, rms: Callable[[Problem, Array], dict[str, float]]
) -> tuple[float, float]:
    """Energy above the floor, in squared floors, without and with a fit."""
    floors = rms(c.problem, c.noise.draws)
    before, after = rms(c.problem, none.residual), rms(c.problem, f.residual)
    ratios = [(before[s] / v, after[s] / v) for s, v in floors.items() if v > 0.0]
    return (
        sum(max(b**2 - 1.0, 0.0) for b, _ in ratios),
        sum(max(a**2 - 1.0, 0.0) for _, a in ratios),
    )


def _with_spikes(c: Calibrated) -> Callable[[Problem, Array], dict[str, float]]:
    def rms(problem: Problem, flat: Array) -> dict[str, float]:
        white2 = np.mean((np.atleast_2d(flat) / c.noise.sigma) ** 2, axis=0)
        out = {}
        for signal in problem.signals:
            parts = [white2[x.part][c.train[x.part]] for x in problem.series if x.signal == signal]
            out[signal] = float(np.sqrt(np.mean(np.concatenate(parts)))) if parts else 0.0
        return out

    return rms
