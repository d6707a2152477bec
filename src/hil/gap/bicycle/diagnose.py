"""Which effect makes the gap of a ride: the steps of `hil.gap.diagnose`, on the bicycle's candidates."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable
from dataclasses import replace

import numpy as np

from hil.config import BicycleFile
from hil.gap.bicycle.leaves import ride_nuisances
from hil.gap.bicycle.locate import locate_rides
from hil.gap.diagnose import DRIFT, explain
from hil.gap.diagnosis import Diagnosis
from hil.gap.frames import EFFECT as LOST
from hil.gap.nuisances import Nuisance
from hil.runs import Run


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
        by_name = {n.name: n for n in ride_nuisances(rig, found.evidence.problem)}
        nuisances = [
            replace(
                by_name[f.name],
                mean=f.change,
                sd=float(np.hypot(f.sd, DRIFT * by_name[f.name].sd)),
            )
            for f in found.nuisances
        ]
    say("locating the gap")
    located = locate_rides(runs, rig, nuisances=nuisances, seed=seed)
    chosen = nuisances or list(ride_nuisances(rig, located.evidence.problem))
    return explain(located, chosen, without=(*without, LOST), seed=seed, report=say)
