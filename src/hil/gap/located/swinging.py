"""A force that swings beside the twin's all the time: what hangs from the rig, or stands on soft feet.

Kicks of setpoints lift a force's floor where they fall, and in root mean square what swings in between is
lost under them. So spectra are compared, by the median over pieces of a record, of which few have a kick, and
less what stands above the floor at all frequencies, as kicks do where every piece has some.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.signal import welch

from hil.gap.located.result import Located
from hil.gap.record.problem import Problem, Series

Array = NDArray[np.float64]

PIECE_S: Final = 4.0
PIECES: Final = 2.5
"""Pieces that a record must have."""
TOP: Final = 0.8
"""Of the highest frequency of a record, up to which it is looked at."""
HZ: Final = (0.5, 10.0)
"""Slower is what friction and masses are off by, faster is ringing of drives."""


def swings(located: Located, signal: str) -> tuple[float, float]:
    """How many times the floor's the spectrum of what is left of a force is where it stands highest, over
    what it is everywhere, by the geometric mean over its records, and at how many hertz; zeros of other
    signals and where all records are short or slow."""
    e = located.evidence
    rows = np.vstack([e.residual, e.noise.draws])
    asked = [
        x for x in e.problem.series if x.signal == signal and x.quantity in ("force", "current")
    ]
    told = [p for x in asked if (p := _stands(e.problem, x, rows)) is not None]
    if not told:
        return 0.0, 0.0
    top_hz = min(HZ[1], *(TOP * hz[-1] for hz, _, _ in told))
    at_hz = np.arange(HZ[0], top_hz, 1.0 / PIECE_S)
    logs = [np.interp(at_hz, hz, times) for hz, times, _ in told]
    mean = np.average(logs, axis=0, weights=[length for _, _, length in told])
    k = int(np.argmax(mean))
    return float(np.exp(mean[k])), float(at_hz[k])


def _stands(problem: Problem, x: Series, rows: Array) -> tuple[Array, Array, int] | None:
    """Hz (F,), the log of how many times the floor's the first of rows (R, N) is there in a series (F,) over
    what it is everywhere, and its length; None of a short or slow one."""
    t = problem.t_s[x.part]
    step = float(np.median(np.diff(t)))
    grid = np.arange(t[0], t[-1], step)
    count = round(PIECE_S / step)
    if len(grid) < PIECES * count or TOP * 0.5 / step <= HZ[0]:
        return None
    even = np.array([np.interp(grid, t, row) for row in rows[:, x.part]])
    hz, power = welch(
        even, 1.0 / step, nperseg=count, noverlap=3 * count // 4, axis=-1, average="median"
    )
    floor = np.maximum(power[1:].mean(axis=0), 1e-300)
    times = 0.5 * np.log(np.maximum(power[0], 1e-300) / floor)
    everywhere = float(np.median(times[(hz >= HZ[0]) & (hz < TOP * hz[-1])]))
    return hz, times - max(everywhere, 0.0), len(grid)
