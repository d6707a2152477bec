"""Which sets of effects stand: each effect explains much of what the others leave."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

from hil.gap.fits.fitted import Calibrated, Fit
from hil.gap.fits.heldout import touched
from hil.gap.fits.shares import explained

ADDS: Final = 0.4
OWN: Final = 0.7
"""Of what the others leave, the least that a further effect must explain, of all or on the signals that are
its own: less is how laws differ."""
DONE: Final = 0.5
"""Of what stands on a signal, from which on it is theirs who explain it: a platform carries what one leg
does to the forces of all."""
BROUGHT_BACK: Final = 6.0
"""Nats of the nuisances' priors that a further effect saves which had been hidden in them: on healthy records
no effect saves more than 5 beside a few nats of evidence."""


def cost_of(c: Calibrated, f: Fit) -> float:
    """What a fit leaves, in nats, with what its starts have cost."""
    return f.total(c) + f.extra_cost


def adds(c: Calibrated, fits: Sequence[Fit], joint: Fit, least: float = ADDS) -> bool:
    """Whether each effect of a set explains more than a share `least` of what the others leave, or most of it
    on signals of which they leave most, or brings nuisances back, as far as those are among `fits`."""
    names = {leaf.name for leaf in joint.leaves}
    parts = [f for f in fits if {leaf.name for leaf in f.leaves} < names]
    return all(goes_further(c, f, joint, least) for f in parts)


def goes_further(c: Calibrated, f: Fit, joint: Fit, least: float = ADDS) -> bool:
    """Whether a set explains more than a share `least` of what `f` leaves, or most of it on signals of
    which `f` leaves most, or brings back nuisances that `f` leaves far off."""
    return (
        explained(c, f, joint) > least
        or _owns(c, f, joint)
        or f.prior_cost - joint.prior_cost > BROUGHT_BACK
    )


def _owns(c: Calibrated, f: Fit, joint: Fit) -> bool:
    """Whether what a set adds to `f` explains most of what stands on the signals of which `f` leaves most;
    none of those that it makes worse."""
    none = replace(f, residual=c.residual)
    before, after = (c.noise.weighted_rms(c.problem, r) for r in (none.residual, f.residual))
    done = {
        s
        for s in touched(c, none, f)
        if after[s] > before[s] or explained(c, none, f, signals=(s,)) > DONE
    }
    signals = [s for s in touched(c, f, joint) if s not in done]
    return bool(signals) and explained(c, f, joint, signals=signals) > OWN
