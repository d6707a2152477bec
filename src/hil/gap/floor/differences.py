"""How loud noise is by what repeats of one motion differ by.

Half the difference of the residuals of two repeats is noise and nothing else, as far as the twin says the
same of both and it is no more than sensors and bus can make: what else does not repeat is gap.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hil.gap.floor.loudness import mean_square
from hil.gap.record.problem import Problem
from hil.gap.record.repeats import Repeats

Array = NDArray[np.float64]
Index = NDArray[np.int64]

SPIKE: Final = 4.0
"""Typical spreads by which a residual may leave its neighbours: a frame that missed a tick kicks harder."""
USUAL: Final = 0.8
"""Share of the samples, the quieter ones, that tell a gap from many frames that came at the wrong tick."""
UNSTEADY: Final = 3.0
"""Times the model that noise may have by repeats and by the record's level at most: on healthy rigs of two
worlds that is below 2 for forces and 3.1 for accelerometers; what else does not repeat is gap."""
QUIETEST: Final = 0.02
"""Times the model that noise is at least: a simulation without noise repeats itself to the last digit."""
FORCED: Final = 1.0
"""The same where setpoints are forces: the slow force that no twin knows is part of the model, and as much a
matter of place as motions are, so repeats hold the same of it."""
ALIKE: Final = 3.0
"""Spreads of noise by which two repeats may be predicted to differ."""
RARE: Final = 1.8
"""Times what the usual samples say, from which on differences of repeats are rare events and no noise."""


def times_louder(measured: Array, modelled: Array, spread: Array) -> float:
    """Times that differences of repeats (M,) are larger than `modelled` ones (D, M).

    Where some are RARE beside the usual ones, for frames that one of two lost are no noise, both are cut at
    SPIKE times their `spread` (M,), as spikes are everywhere.
    """
    usual, all_of_them = (
        float(np.sqrt(mean_square(measured, share) / max(mean_square(modelled, share), 1e-300)))
        for share in (USUAL, 1.0)
    )
    least = float(np.mean(np.clip(modelled, -SPIKE * spread, SPIKE * spread) ** 2))
    times = usual
    for _ in range(2):
        most = SPIKE * times * spread
        times = float(np.sqrt(np.mean(np.clip(measured, -most, most) ** 2) / max(least, 1e-300)))
    times = min(times, RARE * usual)
    return times if all_of_them > RARE * usual else max(times, all_of_them)


def by_repeats(
    problem: Problem,
    drawn: Array,
    repeats: Sequence[Repeats],
    residual: Array,
    by_level: Mapping[str, float],
    sigma: Array,
) -> tuple[Array, Mapping[str, float]]:
    """Draws scaled signal by signal to what repeats differ by, where the twin says the same of them: what is
    shaken into one of them is no noise. Up to UNSTEADY times the model, with what `by_level` did before."""
    out = np.array(drawn)
    factors = {}
    predicted = problem.measured - residual
    spread = np.sqrt(np.mean(drawn**2, axis=0))
    for signal in problem.signals:
        pairs = [_alike(*r.pairs[signal], predicted, spread) for r in repeats if signal in r.pairs]
        if sum(len(first) for first, _ in pairs) < 50:
            continue
        measured = np.concatenate([residual[first] - residual[second] for first, second in pairs])
        modelled = np.hstack([drawn[:, first] - drawn[:, second] for first, second in pairs])
        both = np.concatenate([np.hypot(sigma[first], sigma[second]) for first, second in pairs])
        most = UNSTEADY / max(by_level.get(signal, 1.0), 1.0)
        least = FORCED if problem.are_forces else QUIETEST
        factors[signal] = min(max(times_louder(measured, modelled, both), least), most)
        for x in problem.series:
            if x.signal == signal:
                out[:, x.part] *= factors[signal]
    return out, factors


def _alike(first: Index, second: Index, predicted: Array, spread: Array) -> tuple[Index, Index]:
    """Those of paired samples that are predicted alike, as far as frames that never come at the very same
    instants of a period allow; at least half of them."""
    apart = np.abs(predicted[first] - predicted[second]) / spread[first]
    same = apart <= max(ALIKE, float(np.median(apart)))
    return first[same], second[same]
