"""What a diagnosis was asked, the same in all its rounds."""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass

from hil.config import RigFile
from hil.gap.catalogue.nuisances import Nuisance, default_nuisances
from hil.gap.located.locate import locate
from hil.gap.located.result import Located
from hil.gap.record.missing import Missing
from hil.gap.record.problem import Problem
from hil.gap.record.ticks import Clocks
from hil.runs import Run

Report = Callable[[str], None]


@dataclass(frozen=True, slots=True)
class Question:
    """The runs, and what is known beside them."""

    runs: tuple[Run, ...]
    without: Collection[str]
    """Effects that must not be considered."""
    seed: int
    say: Report
    """Told each step."""
    missing: Missing
    """The drives' answers that never came."""
    healthy: Located | None = None
    """What was located on references."""
    known: tuple[Nuisance, ...] | None = None
    """Nuisances as references leave them."""

    def locate(
        self,
        rig: RigFile,
        clocks: Clocks | None = None,
        near: Located | None = None,
        *,
        is_tried: bool = True,
    ) -> Located:
        """The gap between the runs and the twin of `rig`; `clocks`: the drives' ticks, if they are known;
        `near`, `is_tried`: as in `hil.gap.locate`."""
        return locate(
            self.runs, rig, nuisances=self.known, healthy=self.healthy, clocks=clocks, near=near,
            is_tried=is_tried, seed=self.seed,
        )  # fmt: skip

    def nuisances(self, problem: Problem) -> tuple[Nuisance, ...]:
        """Those that a refit may move."""
        return self.known or nuisances_of(problem)


def nuisances_of(problem: Problem) -> tuple[Nuisance, ...]:
    """Those of a rig of which no references tell more than its file."""
    return default_nuisances(problem.rig, problem.signals, are_forces=problem.are_forces)
