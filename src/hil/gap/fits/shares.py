"""How much of the gap stands and how much a fit takes away, in floors of the signals and as a share."""

from __future__ import annotations

from collections.abc import Collection
from typing import Final

import numpy as np

from hil.gap.fits.fitted import Calibrated, Fit

FAINT: Final = 0.3
"""Squared floors of energy above the floor that are too few to speak of."""
RARE: Final = 1.35
"""Floors of the usual residual up to which a gap is one of rare events."""


def largest_ratio(c: Calibrated, f: Fit) -> float:
    """Largest usual residual of a signal on training samples, in its floor."""
    left = c.noise.usual(c.problem, f.residual)
    return max(left[s] / v for s, v in c.usual_floors.items() if v > 0.0)


def most_left(c: Calibrated, f: Fit) -> float:
    """Largest residual of a signal on training samples, in its floor: of the usual samples, or of all."""
    left = c.noise.weighted_rms(c.problem, f.residual)
    return max(largest_ratio(c, f), *(left[s] / v for s, v in c.floors.items() if v > 0.0))


def explained(
    c: Calibrated,
    none: Fit,
    f: Fit,
    is_sure: bool = False,
    signals: Collection[str] | None = None,
) -> float:
    """Share of the gap above the floor that a fit takes away on training samples (of `signals`), 0..1.

    Of its energy, lone spikes cut as everywhere. A gap that stands in rare events is those spikes: there the
    share is that of the robust loss, in which each counts but none for all. `is_sure`: the fit is beyond
    doubt, so what it leaves shows that no more than that is noise: a fast gap makes a record look noisy.
    """
    floors = c.floors
    before = c.noise.weighted_rms(c.problem, none.residual)
    after = c.noise.weighted_rms(c.problem, f.residual)
    if is_sure:
        floors = {s: min(v, after[s]) for s, v in floors.items()}
    asked = floors if signals is None else signals
    ratios = [(before[s] / floors[s], after[s] / floors[s]) for s in asked if floors[s] > 0.0]
    was, share = _gone(ratios)
    if was < FAINT or largest_ratio(c, none) < RARE:
        return max(share, _robustly(c, none, f))
    return share


def usually_explained(c: Calibrated, none: Fit, f: Fit) -> float:
    """Share of the usual gap above the floor, 0..1: what impacts leave for moments, as flanks of another law
    meet at other instants, is no part of it."""
    before, after = (c.noise.usual(c.problem, r) for r in (none.residual, f.residual))
    ratios = [(before[s] / v, after[s] / v) for s, v in c.usual_floors.items() if v > 0.0]
    return _gone(ratios)[1]


def _gone(ratios: Collection[tuple[float, float]]) -> tuple[float, float]:
    """Energy above the floor before, and the share of it that has gone: `ratios` of signals to their floors,
    before and after."""
    was = sum(max(b**2 - 1.0, 0.0) for b, _ in ratios)
    left = sum(max(a**2 - 1.0, 0.0) for _, a in ratios)
    return was, float(np.clip((was - left) / max(was, FAINT), 0.0, 1.0))


def above_noise(c: Calibrated, f: Fit) -> float:
    """Nats of the robust loss that a fit leaves above the floor; 0 where that is no more than chance."""
    left = f.cost(c.train) - float(np.mean(c.drawn))
    return left if left > float(np.std(c.drawn)) else 0.0


def _robustly(c: Calibrated, none: Fit, f: Fit) -> float:
    was = above_noise(c, none)
    if was == 0.0:
        return 0.0
    return float(np.clip((none.cost(c.train) - f.cost(c.train)) / was, 0.0, 1.0))
