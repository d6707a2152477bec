"""How loud a record is beside the noise model: its sensors, and its timing.

Told by the median size of a residual's second differences, which leave out what is slow and what is rare:
kicks at reversals, lost frames. Samples that hardly feel time tell of the sensors, those that do of timing.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hil.gap.record.problem import Problem

Array = NDArray[np.float64]

LEVEL_RANGE: Final = (0.3, 3.0)
"""Times the noise model; more than that in the fastest part of a residual is gap."""
LOUDEST: Final = {"position": 1.4, "velocity": 1.4}
"""The same for sensors of motion, whose steps and noise are known: on healthy rigs they are below 1.3."""
BY_SENSORS: Final = {"force": (1.5, 0.35), "current": (1.5, 0.35)}
"""The same for what sensors of force alone make, and what is added for each time that timing is larger than
they are: where all of a record feels time, none of it tells of sensors alone [set on healthy rigs of three
worlds, which stay below]."""
LOUDER: Final = 1.1
"""Times all that is left, that its noise may have by the model: weights and chance make that much."""
COMMON: Final = 0.98
"""Share of the samples, the smaller ones, that tell how loud a record is; the rest are its spikes."""
HEALTHY: Final = 1.25
"""Times the level that a healthy reference has by the same model: a run is no noisier than that by itself."""
CALM: Final = 0.4
LIVELY: Final = 0.6
"""Quantiles of how much samples feel time, below which they tell of sensors and above which of timing."""
AS_LIVELY: Final = 0.5
"""Of the run's part of timing in its noise, that a reference must have to tell the level of it."""


@dataclass(frozen=True, slots=True)
class Level:
    """How loud a record is beside the noise model: times the sensors' part, times timing's, and how large
    timing's part is over the sensors'."""

    sensed: float
    late: float
    lively: float

    @property
    def factor(self) -> float:
        """Times the model, both parts together."""
        return math.hypot(self.sensed, self.late * self.lively) / math.hypot(1.0, self.lively)


def as_loud(
    problem: Problem,
    late: Array,
    sensed: Array,
    residual: Array,
    healthy: Mapping[str, Level],
) -> tuple[Array, dict[str, Level]]:
    """Draws of timing and sensors brought series by series to the level of a residual.

    To the median size of its second differences, which leave out what is slow and what is rare: kicks at
    reversals, lost frames. And never louder than the whole residual is, for that holds the noise: what the
    bus may do to timing at most is often more than this bus does. Nor much louder than a healthy record.
    """
    out, levels = late + sensed, dict[str, Level]()
    for x in problem.series:
        kept = problem.kept[x.part]
        if kept.sum() < 50:
            continue
        left = residual[x.part][kept]
        a, b = late[:, x.part][:, kept], sensed[:, x.part][:, kept]
        lively = float(np.sqrt(mean_square(a) / max(mean_square(b), 1e-300)))
        alone, by_timing = BY_SENSORS.get(x.quantity, (LEVEL_RANGE[1], 0.0))
        most = (
            min(LOUDEST.get(x.quantity, LEVEL_RANGE[1]), alone + by_timing * lively),
            LEVEL_RANGE[1],
        )
        usual = healthy.get(x.signal)
        if usual is not None:
            as_lively = usual.lively > AS_LIVELY * lively
            most = (
                min(most[0], HEALTHY * usual.sensed),
                min(most[1], HEALTHY * usual.late) if as_lively else most[1],
            )
        of_sensors, of_timing = level_of(left, a, b, most)
        out[:, x.part] = of_timing * late[:, x.part] + of_sensors * sensed[:, x.part]
        known = levels.get(x.signal, Level(0.0, 0.0, 0.0))
        levels[x.signal] = Level(
            max(of_sensors, known.sensed), max(of_timing, known.late), max(lively, known.lively)
        )
    return out, levels


def level_of(
    left: Array, late: Array, sensed: Array, most: tuple[float, float]
) -> tuple[float, float]:
    """What draws of sensors and of timing (D, M) are multiplied by, `most` at most, to be as loud as `left`
    (M,): the one by what hardly feels time, the other by what feels it. Timing is no quieter than the model,
    for its kicks are rare, unless all of `left` is."""
    felt = np.sqrt(np.mean(np.diff(late, 2, axis=1) ** 2, axis=0))
    calm, lively = felt <= np.quantile(felt, CALM), felt > np.quantile(felt, LIVELY)
    fine = np.abs(np.diff(left, 2))
    s, t = 1.0, 1.0
    for _ in range(6):
        size = np.abs(np.diff(t * late + s * sensed, 2, axis=1))
        s = float(np.clip(s * _times(fine, size, calm), *LEVEL_RANGE))
        size = np.abs(np.diff(t * late + s * sensed, 2, axis=1))
        t = float(np.clip(t * _times(fine, size, lively), 1.0, LEVEL_RANGE[1]))
        room = LOUDER**2 * mean_square(left) - s**2 * mean_square(sensed)
        t = min(t, float(np.sqrt(max(room, 0.0) / max(mean_square(late), 1e-300))))
    return min(s, most[0]), min(t, max(most[1], 1.0))


def _times(fine: Array, size: Array, some: NDArray[np.bool_]) -> float:
    """How many times larger the median of `fine` (M,) is than that of `size` (D, M) where `some` (M,)."""
    if not some.any():
        return 1.0
    return float(np.median(fine[some])) / max(float(np.median(size[:, some])), 1e-300)


def mean_square(values: Array, share: float = COMMON) -> float:
    """Of the smaller `share` of `values`."""
    size = np.sort(values.ravel() ** 2)
    return float(np.mean(size[: max(int(share * len(size)), 1)]))
