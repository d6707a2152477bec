"""Which effect makes the gap: candidates proposed, fitted, weighed, and scored on data held out."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from dataclasses import replace
from typing import Final

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from hil.config import RigFile
from hil.gap.bank import fill_bank
from hil.gap.diagnosis import Cause, Diagnosis, Held
from hil.gap.evidence import Weighed, classes, weigh
from hil.gap.fit import Calibrated, Fit, calibrated, changes_of, fit
from hil.gap.heldout import score, split, touched
from hil.gap.leaves import Leaf, find_leaves
from hil.gap.locate import locate
from hil.gap.nuisances import Nuisance, default_nuisances
from hil.gap.result import Located
from hil.gap.runs import as_runs
from hil.gap.search import Proposal, Search
from hil.runs import Run

Array = NDArray[np.float64]

FITTED: Final = 6
"""Single candidates that are fitted through the twin."""
PAIRS: Final = 3


def diagnose(
    runs: Run | pd.DataFrame | Iterable[Run | pd.DataFrame],
    rig: RigFile,
    *,
    references: Run | pd.DataFrame | Iterable[Run | pd.DataFrame] = (),
    without: Collection[str] = (),
    seed: int = 0,
) -> Diagnosis:
    """Diagnose the gap."""
    loaded = as_runs(runs, rig)
    healthy = as_runs(references, rig)
    nuisances = _calibration(healthy, rig, seed) if healthy else None
    located = locate(loaded, rig, nuisances=nuisances, seed=seed)
    return explain(located, nuisances, without, seed)


def explain(located, nuisances, without=(), seed=0):
    e = located.evidence
    problem = e.problem
    rng = np.random.default_rng(seed + 1)
    train, held_text = split(problem, list(range(len(problem.pieces))))
    chosen = nuisances or default_nuisances(problem.rig, problem.signals, e.timing.delays_s)
    from hil.gap.residual import Refit

    c = calibrated(problem, e.noise, chosen, Refit(e.vector, e.residual, e.jacobian, ()), train)
    none = fit(c, (), {})
    base = problem.measured - none.residual
    leaves = find_leaves(problem, none.vector, none.residual, without)
    bank = fill_bank(problem, none.vector, base, leaves)
    c = replace(c, vector=none.vector, residual=none.residual, white=none.white, z=none.z)
    search = Search(c, bank)
    alone = search.alone()
    singles = {}
    for p in alone[:FITTED]:
        f = fit(c, [leaves[p.leaves[0]]], changes_of([leaves[p.leaves[0]]], p.starts, problem))
        if f is not None:
            singles[p.leaves[0]] = (p, f)
    return c, none, leaves, bank, search, alone, singles
