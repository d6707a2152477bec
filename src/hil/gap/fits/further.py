"""Effects that calibrations set right too, but stand further than those leave anything.

Each nuisance is bounded, and a healthy rig keeps within its bound. One that stands at it hides what stands
further: little of that is left in any signal, and what is left may be below every threshold of a trace.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from hil.gap.catalogue.nuisances import Nuisance
from hil.gap.fits.fitted import Calibrated, Fit
from hil.gap.record.leaf import Leaf
from hil.gap.record.problem import Problem

STRAINED: Final = 2.7
"""Prior deviations from which on a nuisance stands near its bound."""
FURTHER: Final = 4.5
"""Prior deviations from which on no calibration leaves it."""


def deviations(problem: Problem, n: Nuisance, value: float) -> float:
    """Prior deviations by which a nuisance stands off at `value`, from where calibrations leave it."""
    return float((value - problem.base[problem.table.index(n.name)] - n.mean) / n.sd)


def is_further(c: Calibrated, without: Fit, f: Fit, leaves: Sequence[Leaf]) -> bool:
    """Whether each of `leaves` is a nuisance that a fit `without` them takes to its bound, and that `f` has
    still further on the same side."""
    values = dict(zip(f.names, f.values.tolist(), strict=True))

    def stands_out(leaf: Leaf) -> bool:
        for n, z in zip(c.nuisances, without.z.tolist(), strict=True):
            if n.name not in leaf.parameters or n.name not in values or abs(z) < STRAINED:
                continue
            away = deviations(c.problem, n, values[n.name])
            if abs(away) > FURTHER and away * z > 0.0:
                return True
        return False

    return bool(leaves) and all(map(stands_out, leaves))
