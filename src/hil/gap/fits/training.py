"""What fits begin with: the samples that they see, the twin calibrated on them, columns of all candidates."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace

import numpy as np

from hil.gap.catalogue.bank import Bank, fill_bank
from hil.gap.catalogue.leaves import find_leaves
from hil.gap.catalogue.nuisances import Nuisance
from hil.gap.fits.fit import fit
from hil.gap.fits.fitted import Calibrated, Fit, calibrated
from hil.gap.fits.heldout import Split
from hil.gap.fits.restrict import noise_of, part_of
from hil.gap.floor.rounding import coarser
from hil.gap.located.residual import Refit
from hil.gap.located.result import Evidence


def begin(
    e: Evidence,
    parts: Split,
    nuisances: Sequence[Nuisance],
    steps: Mapping[str, float],
    seed: int,
) -> tuple[Calibrated, Fit]:
    """The calibrated twin on what `parts` lets fits see, and its fit without effects. `steps`: by signal,
    those that its values come in."""
    problem, rows = part_of(e.problem, parts)
    noise = noise_of(e.noise, e.problem, problem, rows)
    if steps:
        noise = coarser(noise, problem, steps, np.random.default_rng(seed + 1))
    start = Refit(e.vector, e.residual[rows], e.jacobian[rows], ())
    c = calibrated(problem, noise, nuisances, start)
    none = fit(c, (), {})
    if none is None:
        raise AssertionError("the calibrated twin stood a moment ago")
    return replace(c, vector=none.vector, residual=none.residual, white=none.white, z=none.z), none


def candidates_of(
    c: Calibrated, none: Fit, without: Collection[str], known: Bank | None = None
) -> Bank:
    """What each candidate would do, but those of effects `without`; most of it as in `known`, the bank of
    another twin and the same samples."""
    leaves = find_leaves(c.problem, none.vector, none.residual, without)
    return fill_bank(c.problem, none.vector, c.problem.measured - none.residual, leaves, known)
