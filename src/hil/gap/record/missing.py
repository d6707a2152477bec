"""Answers that never came, by the slots that they left empty while setpoints went out all the same."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hil.identify.replay import stretches
from hil.runs import Run

Array = NDArray[np.float64]

HOLE: Final = 10.0
"""Slots from which on nobody recorded, or asked for something else."""
NEARLY: Final = 0.25
"""Of a slot: setpoints that went out for no more than half of one say nothing of an answer."""
BOTH: Final = 1.1
"""Answers for each setpoint from which on one asks for more than one signal."""
FEWEST: Final = 8
"""Answers missing from which on it is no chance that they are."""
SOME: Final = 0.001
"""Share of them from which on a bus loses some [of 328 cases of four worlds of others, none of which lost
any, none lacks half as many]."""


@dataclass(frozen=True, slots=True)
class Missing:
    """Of the drives' answers, how many never came, and of how many."""

    count: int = 0
    slots: int = 0
    is_finding: bool = False
    """Whether they are more than by chance, and than twice what references lack."""

    @property
    def share(self) -> float:
        """Of all that were due."""
        return self.count / max(self.slots, 1)


def missing_answers(runs: Sequence[Run], references: Sequence[Run]) -> Missing:
    """Of all drives' answers of `runs`, those that are missing. Rows that are empty because the host sent
    nothing either, or because a record has a hole, are none."""
    (count, slots), (old, of) = _counted(runs), _counted(references)
    share, before = count / max(slots, 1), old / max(of, 1)
    return Missing(count, slots, count >= FEWEST and share > max(SOME, 2.0 * before))


def _counted(runs: Sequence[Run]) -> tuple[int, int]:
    counts = [
        _missing(t, sent)
        for run in runs
        for piece in stretches(run)
        for actuator, (sent, _) in piece.setpoints.items()
        for t in _instants(
            [s for n, (s, _) in piece.samples.items() if n.startswith(actuator + ".")], sent
        )
    ]
    return sum(c for c, _ in counts), sum(n for _, n in counts)


def _instants(signals: Sequence[Array], setpoints: Array) -> Sequence[Array]:
    """When answers of a drive came: all in one where each setpoint asks for one signal, in any order; else
    by signal."""
    answers = sum(map(len, signals))
    return [np.sort(np.concatenate(signals))] if 0 < answers < BOTH * len(setpoints) else signals


def _missing(t: Array, setpoints: Array) -> tuple[int, int]:
    """So many of so many answers: by time, or by the setpoints that went out meanwhile, if they say fewer."""
    if len(t) < FEWEST:
        return 0, 0
    steps, sent = np.diff(t), np.diff(np.searchsorted(setpoints, t))
    usual, each = float(np.median(steps)), float(np.median(sent))
    if not (usual > 0.0 and each >= 1.0):
        return 0, 0
    slots = np.minimum(np.round(steps / usual), np.floor(sent / each + NEARLY))
    slots = np.maximum(slots, 1.0)[slots < HOLE]
    return int(np.sum(slots - 1.0)), int(np.sum(slots))
