"""What fits begin with: the samples that they see, the twin calibrated on them, columns of all candidates."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace

import numpy as np

from hil.gap.bank import Bank, fill_bank
from hil.gap.fit import Calibrated, Fit, calibrated, fit
from hil.gap.heldout import Split
from hil.gap.leaves import find_leaves
from hil.gap.nuisances import Nuisance
from hil.gap.residual import Refit
from hil.gap.restrict import noise_of, part_of
from hil.gap.result import Evidence
from hil.gap.rounding import coarser
from hil.gap.search import Search


def begin(
    e: Evidence,
    parts: Split,
    nuisances: Sequence[Nuisance],
    without: Collection[str],
    say: Callable[[str], None],
    steps: Mapping[str, float],
    seed: int,
    bank: Bank | None = None,
) -> tuple[Calibrated, Fit, Search]:
    """The calibrated twin on what `parts` lets fits see, its fit without effects, and the search among the
    candidates but those of effects `without`. `steps`: by signal, those that its values come in. `bank`: what
    candidates do, where that is known."""
    problem, rows = part_of(e.problem, parts)
    noise = noise_of(e.noise, e.problem, problem, rows)
    if steps:
        noise = coarser(noise, problem, steps, np.random.default_rng(seed + 1))
    start = Refit(e.vector, e.residual[rows], e.jacobian[rows], ())
    c = calibrated(problem, noise, nuisances, start)
    none = fit(c, (), {})
    if none is None:
        raise AssertionError("the calibrated twin stood a moment ago")
    c = replace(c, vector=none.vector, residual=none.residual, white=none.white, z=none.z)
    if bank is None:
        say("computing what each candidate would do")
        leaves = find_leaves(problem, none.vector, none.residual, without)
        bank = fill_bank(problem, none.vector, problem.measured - none.residual, leaves)
    return c, none, Search(c, bank)
