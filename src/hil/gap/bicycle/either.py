"""One call for either sort of rig: driven rigs go to `hil.gap`, ridden ones to the bicycle's problem."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable

from hil.config import AnyRig, BicycleFile
from hil.gap.bicycle.diagnose import diagnose_rides
from hil.gap.bicycle.locate import locate_rides
from hil.gap.diagnose import diagnose
from hil.gap.judged.diagnosis import Diagnosis
from hil.gap.located.locate import locate
from hil.gap.located.result import Located
from hil.runs import Run


def locate_any(runs: Iterable[Run], rig: AnyRig, *, seed: int = 0) -> Located:
    """`hil.gap.locate`, or `locate_rides`, as `rig` is."""
    loaded = list(runs)
    if isinstance(rig, BicycleFile):
        return locate_rides(loaded, rig, seed=seed)
    return locate(loaded, rig, seed=seed)


def diagnose_any(
    runs: Iterable[Run],
    rig: AnyRig,
    *,
    references: Iterable[Run] = (),
    without: Collection[str] = (),
    seed: int = 0,
    report: Callable[[str], None] | None = None,
) -> Diagnosis:
    """`hil.gap.diagnose`, or `diagnose_rides`, as `rig` is; arguments as theirs."""
    loaded, healthy = list(runs), list(references)
    if isinstance(rig, BicycleFile):
        return diagnose_rides(
            loaded, rig, references=healthy, without=without, seed=seed, report=report
        )
    return diagnose(loaded, rig, references=healthy, without=without, seed=seed, report=report)
