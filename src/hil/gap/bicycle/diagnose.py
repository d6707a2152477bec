"""Which effect makes the gap of a ride: the steps of `hil.gap.diagnose`, on the bicycle's candidates."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable
from dataclasses import replace
from typing import Final

import numpy as np

from hil.config import BicycleFile
from hil.gap.bicycle.leaves import ride_nuisances
from hil.gap.bicycle.locate import locate_rides
from hil.gap.bicycle.noise import with_tolerances
from hil.gap.diagnose import as_found, explain
from hil.gap.diagnosis import Diagnosis
from hil.gap.frames import EFFECT as LOST
from hil.gap.nuisances import Nuisance
from hil.gap.verdict import judge
from hil.runs import Run

EXPLAINED: Final = 0.72
"""Share of a gap's energy that a verdict must explain, half of the time [set on training cases]."""
SOFT: Final = 0.06


def diagnose_rides(
    runs: Iterable[Run],
    rig: BicycleFile,
    *,
    references: Iterable[Run] = (),
    without: Collection[str] = (),
    seed: int = 0,
    report: Callable[[str], None] | None = None,
) -> Diagnosis:
    """Diagnose the gap between rides and the bicycle's model; arguments as of `hil.gap.diagnose`."""
    say = report or (lambda _: None)
    healthy = list(references)
    nuisances: list[Nuisance] | None = None
    if healthy:
        say("calibrating on the healthy references")
        found = locate_rides(healthy, rig, seed=seed)
        nuisances = as_found(found, ride_nuisances(rig, found.evidence.problem))
    say("locating the gap")
    located = locate_rides(runs, rig, nuisances=nuisances, seed=seed)
    e = located.evidence
    chosen = nuisances or list(ride_nuisances(rig, e.problem))
    noise = with_tolerances(e, np.array([n.sd for n in chosen]), np.random.default_rng(seed + 1))
    counted = replace(located, evidence=replace(e, noise=noise))
    return _by_energy(explain(counted, chosen, without=(*without, LOST), seed=seed, report=say))


def _by_energy(found: Diagnosis) -> Diagnosis:
    """The same with the chance of an unknown cause by the share of the gap's energy on the training data.

    A ride's gap stands in few seconds, tens of floors high; `explain` counts in nats, in which those few
    seconds are little. What is left of the energy says whether a cause is missing.
    """
    c, none, best = found.calibrated, found.none, found.best
    if c is None or none is None or best is None or not found.causes:
        return found
    floors = c.noise.floor(c.problem)
    energy: dict[str, list[float]] = {}
    for x in c.problem.series:
        rows = c.problem.kept[x.part]
        sums = energy.setdefault(x.signal, [0.0, 0.0, 0.0])
        sums[0] += float(np.sum(none.residual[x.part][rows] ** 2)) / floors[x.signal] ** 2
        sums[1] += float(np.sum(best.residual[x.part][rows] ** 2)) / floors[x.signal] ** 2
        sums[2] += float(rows.sum())
    was = sum(max(before / n - 1.0, 0.0) for before, _, n in energy.values())
    left = sum(max(after / n - 1.0, 0.0) for _, after, n in energy.values())
    share = 1.0 - left / max(was, 1e-9)
    unknown = float(1.0 / (1.0 + np.exp((share - EXPLAINED) / SOFT)))
    factor = (1.0 - unknown) / max(1.0 - found.unknown, 1e-12)
    causes = tuple(replace(x, probability=x.probability * factor) for x in found.causes)
    chosen = tuple(
        next(x for x in causes if (x.effect, x.location) == (leaf.effect, leaf.location))
        for leaf in best.leaves
    )
    shrink = None if found.score is None else found.score.shrink
    verdict, sentence = judge(chosen, causes, unknown, shrink)
    return replace(
        found,
        verdict=verdict,
        sentence=sentence,
        causes=causes,
        effects=chosen if verdict != "unknown" else (),
        unknown=unknown,
    )
