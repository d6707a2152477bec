"""Which effect makes the gap: candidates proposed, fitted through the twin, weighed, scored on held-out data.

The steps: locate the gap (after the nuisances, calibrated on healthy references where there are any); what
every candidate would do to every sample; the candidates, alone and together, that could explain it; fits of
the best of them; evidence, classes, the chance that it is nothing in the catalogue; shrink on data that no
fit has seen. docs/gap.md says why each is done so.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import replace
from typing import Final

import numpy as np
import pandas as pd

from hil.config import RigFile
from hil.gap.bank import fill_bank
from hil.gap.candidates import fit_candidates
from hil.gap.diagnosis import Diagnosis
from hil.gap.fit import calibrated, fit
from hil.gap.heldout import split
from hil.gap.leaves import find_leaves
from hil.gap.locate import locate
from hil.gap.nuisances import Nuisance, default_nuisances
from hil.gap.residual import Refit
from hil.gap.restrict import noise_of, part_of
from hil.gap.result import Located
from hil.gap.rounding import coarse_steps, coarser, rounded
from hil.gap.runs import as_runs
from hil.gap.search import Search
from hil.gap.shares import weighed_ratio
from hil.gap.verdict import answer, no_gap
from hil.runs import Run

Report = Callable[[str], None]

STRAIN: Final = 2.6
"""Prior standard deviations from which on a nuisance is suspected to hide an effect."""
SUSPECT: Final = 1.2
"""Floors on any signal from which on candidates are weighed at all."""
DRIFT: Final = 0.25
"""Of a nuisance's prior: how far a rig drifts between a reference and a run [R]."""


def diagnose(
    runs: Run | pd.DataFrame | Iterable[Run | pd.DataFrame],
    rig: RigFile,
    *,
    references: Run | pd.DataFrame | Iterable[Run | pd.DataFrame] = (),
    without: Collection[str] = (),
    seed: int = 0,
    report: Report | None = None,
) -> Diagnosis:
    """Diagnose the gap between `runs` (Run objects or pandas frames) and the twin of `rig`.

    `references`: healthy runs of the same rig, on which the nuisances are calibrated first, so that the
    answer is what has changed since. `without`: effects that must not be considered. `report` is told
    each step. Equal `seed`, equal answer. IdentificationError where the data cannot carry an answer.
    """
    say = report or (lambda _: None)
    loaded = as_runs(runs, rig)
    healthy = as_runs(references, rig)
    found, nuisances = None, None
    if healthy:
        say("calibrating on the healthy references")
        found = locate(healthy, rig, seed=seed)
        nuisances = as_found(found, default_nuisances(rig, found.evidence.problem.signals))
    say("locating the gap")
    located = locate(loaded, rig, nuisances=nuisances, healthy=found, seed=seed)
    return explain(located, nuisances, without=without, seed=seed, report=say)


def as_found(found: Located, priors: Sequence[Nuisance]) -> list[Nuisance]:
    """Nuisances as references leave them: where they stand, and as wide as they may still drift.

    `found`: the references located with `priors`.
    """
    by_name = {n.name: n for n in priors}
    out = []
    for f in found.nuisances:
        n = by_name[f.name]
        out.append(replace(n, mean=f.change, sd=float(np.hypot(f.sd, DRIFT * n.sd))))
    return out


def explain(
    located: Located,
    nuisances: Sequence[Nuisance] | None = None,
    *,
    without: Collection[str] = (),
    seed: int = 0,
    report: Report | None = None,
) -> Diagnosis:
    """The diagnosis of what `locate` found, whose `nuisances` are given."""
    say = report or (lambda _: None)
    e = located.evidence
    whole = e.problem
    parts = split(whole, e.noise, e.residual)
    chosen = tuple(nuisances or default_nuisances(whole.rig, whole.signals))
    steps = {} if "sensor_quantisation" in without else coarse_steps(whole)
    if not (
        located.is_gap or steps or _strained(located, chosen) or weighed_ratio(located) > SUSPECT
    ):
        return no_gap(located, parts.text)
    problem, rows = part_of(whole, parts)
    noise = noise_of(e.noise, whole, problem, rows)
    if steps:
        noise = coarser(noise, problem, steps, np.random.default_rng(seed + 1))
    start = Refit(e.vector, e.residual[rows], e.jacobian[rows], ())
    c = calibrated(problem, noise, chosen, start)
    none = fit(c, (), {})
    if none is None:
        raise AssertionError("the calibrated twin stood a moment ago")
    c = replace(c, vector=none.vector, residual=none.residual, white=none.white, z=none.z)
    say("computing what each candidate would do")
    leaves = find_leaves(problem, none.vector, none.residual, without)
    bank = fill_bank(problem, none.vector, problem.measured - none.residual, leaves)
    search = Search(c, bank)
    fits = fit_candidates(c, none, search, leaves, without, say)
    if steps:
        fits = rounded(c, fits, steps)
    return answer(located, c, fits, bank, ~parts.train(whole), parts.text, seed)


def _strained(located: Located, nuisances: Sequence[Nuisance]) -> bool:
    """Whether a nuisance had to go further from its prior's mean than calibrations do."""
    mean = {n.name: n.mean for n in nuisances}
    return any(
        f.at_bound or abs(f.change - mean[f.name]) > STRAIN * f.prior_sd for f in located.nuisances
    )
