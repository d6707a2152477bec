"""Nuisances that had to go further than calibrations leave anything, and what is named in their place."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from hil.gap.catalogue.nuisances import Nuisance
from hil.gap.fits.further import deviations
from hil.gap.judged.diagnosis import Cause, Diagnosis
from hil.gap.located.result import Located

STRAIN: Final = 2.6
"""Prior standard deviations from which on a nuisance has gone further than calibrations leave anything."""
FAR: Final = 3.3
"""The same where an effect that is no nuisance stands for it: of fifteen nuisances one is STRAIN away in
every seventh healthy ride."""
NEARLY: Final = 15.0
"""Nats by which such an effect must explain more than a nuisance that is not FAR."""
HELD: Final = 1e-3
"""Of its prior, within which a nuisance stays that is to explain nothing."""


def strained(found: Diagnosis, located: Located, chosen: Sequence[Nuisance]) -> list[str]:
    """`location.effect` of each nuisance that, beside what was found, went further than calibrations leave
    anything."""
    if found.best is not None and found.calibrated is not None:
        own = {name for leaf in found.best.leaves for name in leaf.parameters}
        names = [n.name for n in found.calibrated.nuisances]
        far = dict(zip(names, np.abs(found.best.z).tolist(), strict=True))
        far = {name: z for name, z in far.items() if name not in own}
    else:
        mean = {n.name: n.mean for n in chosen}
        far = {f.name: abs(f.change - mean[f.name]) / f.prior_sd for f in located.nuisances}
    return sorted({name.rpartition(".")[0] for name, z in far.items() if z > STRAIN})


def held_still(n: Nuisance) -> Nuisance:
    """A nuisance that stays where calibration left it."""
    return replace(n, sd=HELD * n.sd)


def names_more(named: Diagnosis, found: Diagnosis) -> bool:
    """Whether `named` names all that `found` does, or others of their classes, and more."""
    said = {(x.effect, x.location) for x in named.effects}
    alike = [
        {(y.effect, y.location) for y in found.causes if y.group == x.group} for x in found.effects
    ]
    return len(said) > len(alike) and all(some & said for some in alike)


def exceeds_calibration(named: Diagnosis, chosen: Sequence[Nuisance]) -> bool:
    """Whether each effect of `named` that is a nuisance too stands further than calibrations leave it, and
    whether none that calibrations do leave explains nearly as much as the others."""
    far = [(x, _distance(named, x, chosen)) for x in named.causes]
    for x in named.effects:
        away = _distance(named, x, chosen)
        if away is not None and away < STRAIN:
            return False
        if away is None and any(
            near is not None and near < FAR and y.gain > x.gain - NEARLY for y, near in far
        ):
            return False
    return True


def _distance(named: Diagnosis, x: Cause, chosen: Sequence[Nuisance]) -> float | None:
    """Prior deviations by which a cause that is a nuisance too stands off; None of any other."""
    assert named.calibrated is not None
    by_name, problem = {n.name: n for n in chosen}, named.calibrated.problem
    away = [
        abs(deviations(problem, n, p.value))
        for k, p in x.parameters.items()
        if (n := by_name.get(f"{x.location}.{x.effect}.{k}")) is not None
    ]
    return max(away, default=None)
