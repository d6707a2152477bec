"""One call for either sort of rig: driven rigs go to `hil.gap`, ridden ones to the bicycle's problem.

What callers give is looked at here: runs and rigs by path or name, effects that are none, impossible seeds.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from pathlib import Path

from hil.blas import one_blas_thread
from hil.config import AnyRig, BicycleFile
from hil.effectlines import effect_names
from hil.errors import ConfigError, RunError
from hil.gap.bicycle.diagnose import diagnose_rides
from hil.gap.bicycle.locate import locate_rides
from hil.gap.catalogue.nuisances import Nuisance
from hil.gap.diagnose import diagnose
from hil.gap.judged.diagnosis import Diagnosis
from hil.gap.judged.untried import beside_untried
from hil.gap.located.locate import locate
from hil.gap.located.result import Located
from hil.gap.record.runs import SomeRuns, as_rig, as_runs, require_apart
from hil.runs import Run


@one_blas_thread()
def locate_any(
    runs: SomeRuns,
    rig: AnyRig | str | Path,
    *,
    nuisances: Sequence[Nuisance] | None = None,
    healthy: Located | None = None,
    seed: int = 0,
) -> Located:
    """Locate the gap between `runs` and the twin of `rig`, which is driven or ridden.

    `runs`: one or a list of Run objects, pandas frames (column t in s and one a signal), paths of run
    folders. `rig`: as loaded, or its path or name. `nuisances` (default: the rig's own) are refitted first.
    `healthy`: what was located on references of a driven rig, whose noise tells how much can be noise here.
    IdentificationError where the data cannot carry an answer names signal and reason.
    """
    settings = as_rig(rig)
    loaded = _given(runs, settings)
    _check_seed(seed)
    if isinstance(settings, BicycleFile):
        return locate_rides(loaded, settings, nuisances=nuisances, seed=seed)
    return locate(loaded, settings, nuisances=nuisances, healthy=healthy, seed=seed)


@one_blas_thread()
def diagnose_any(
    runs: SomeRuns,
    rig: AnyRig | str | Path,
    *,
    references: SomeRuns | None = None,
    without: Collection[str] = (),
    seed: int = 0,
    report: Callable[[str], None] | None = None,
) -> Diagnosis:
    """Diagnose the gap between `runs` and the twin of `rig`; both as `locate_any` takes them.

    `references`: healthy runs of the same rig, on which the nuisances are calibrated first, so that the
    answer is what has changed since. `without`: names of effects that must not be considered; what is found
    without them is claimed with less, for it may be one of them. `report` is told each step. Equal `seed`,
    equal answer. IdentificationError where the data cannot carry an answer.
    """
    settings = as_rig(rig)
    healthy = [] if references is None else as_runs(references, settings)
    loaded = _given(runs, settings, healthy)
    _check_seed(seed)
    _check_effects(without, settings)
    if isinstance(settings, BicycleFile):
        found = diagnose_rides(
            loaded, settings, references=healthy, without=without, seed=seed, report=report
        )
    else:
        found = diagnose(
            loaded, settings, references=healthy, without=without, seed=seed, report=report
        )
    return beside_untried(found, without)


def _given(runs: SomeRuns, rig: AnyRig, healthy: Sequence[Run] = ()) -> list[Run]:
    loaded = as_runs(runs, rig)
    if not loaded:
        raise RunError("runs: holds no run; give one or a list of some")
    require_apart(loaded, healthy)
    return loaded


def _check_seed(seed: int) -> None:
    if seed < 0:
        raise ValueError(f"seed: {seed} is no seed; it is a whole number from 0 on")


def _check_effects(without: Collection[str], rig: AnyRig) -> None:
    if isinstance(without, str):
        raise TypeError(f"without: is the text {without!r}; give a list of effects: [{without!r}]")
    known = effect_names(rig)
    strange = sorted(set(without).difference(known))
    if strange:
        raise ConfigError(
            f"without: {rig.name} has no effect {', '.join(strange)}; it knows {', '.join(known)}"
        )
