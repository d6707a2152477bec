"""How much of the gap stands and how much a fit takes away, in floors of the signals and as a share."""

from __future__ import annotations

import numpy as np

from hil.gap.fit import Calibrated, Fit
from hil.gap.result import Located


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
    """Share of the gap's energy above the floor that a fit takes away on training samples, 0..1."""
    floors = c.noise.weighted_rms(c.problem, c.noise.draws)
    before = c.noise.weighted_rms(c.problem, none.residual)
    after = c.noise.weighted_rms(c.problem, f.residual)
    ratios = [(before[s] / v, after[s] / v) for s, v in floors.items() if v > 0.0]
    was = sum(max(b**2 - 1.0, 0.0) for b, _ in ratios)
    left = sum(max(a**2 - 1.0, 0.0) for b, a in ratios)
    return float(np.clip((was - left) / max(was, 0.05), 0.0, 1.0))
