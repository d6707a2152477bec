"""Which whole periods of a run are measured: from the experiment's description, or from the cue itself."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hil.errors import IdentificationError
from hil.identify.experiments import experiment_of
from hil.identify.frequency.channels import Channel
from hil.identify.frequency.harmonics import find_period, repeating_stretch
from hil.runs import Run

Array = NDArray[np.float64]

FEWEST_PERIODS: Final = 2
SETTLE_S: Final = 3.0
"""At least so much at the start belongs to the soft start and to transients."""


@dataclass(frozen=True, slots=True)
class Window:
    """Whole periods of one run."""

    start_s: float
    period_s: float
    periods: int
    detection: tuple[int, ...] | None = None
    """Lines that no coordinate is moved with, where the experiment's description tells."""

    def starts(self) -> Array:
        """Start of each period, s."""
        return np.asarray(self.start_s + self.period_s * np.arange(self.periods))


def measuring_windows(
    run: Run, reference: Channel, others: tuple[Channel, ...], period_s: float | None
) -> tuple[Window, ...]:
    """The whole periods to measure, a window a realisation: as the experiment's description says, or as
    the reference shows; none where it is not periodic. IdentificationError where too few are recorded."""
    name = run.path.name
    description = experiment_of(run.path)
    if description is None or description.played is None or not description.period_s:
        found = _find_window(reference, others, period_s, name)
        return () if found is None else (found,)
    if period_s is not None and abs(period_s / description.period_s - 1.0) > 1e-6:
        raise IdentificationError(
            f"{name}: was designed with a period of {description.period_s:g} s, not {period_s:g} s"
        )
    last = min(c.span_s[1] for c in others)
    start_s = description.played.start_s
    windows = [
        Window(
            start_s + segment.start_s, description.period_s, segment.periods, description.detection
        )
        for segment in description.segments
        if segment.periods >= FEWEST_PERIODS
        and start_s + segment.start_s + segment.periods * description.period_s <= last
    ]
    if not windows:
        raise IdentificationError(
            f"{name}: no segment of the experiment has {FEWEST_PERIODS} whole periods recorded: noise "
            "cannot be told from response; play it with more periods"
        )
    return tuple(windows)


def _find_window(
    reference: Channel, others: tuple[Channel, ...], period_s: float | None, name: str
) -> Window | None:
    """The whole, settled periods that all channels share; None where the reference does not repeat.

    `period_s`: if given, the reference must repeat with it: IdentificationError if it does not, or
    where fewer than two periods are left.
    """
    lo, hi = reference.span_s
    step = 1.0 / reference.rate_hz
    t = np.arange(lo, hi, step)
    x = reference.at(t)
    period = find_period(t, x) if period_s is None else period_s
    stretch = None if period is None else repeating_stretch(t, x, period)
    if period is None or stretch is None:
        if period_s is not None:
            raise IdentificationError(
                f"{name}: {reference.name} does not repeat after {period_s:g} s: say its true period, or "
                "none for a record that is not periodic"
            )
        return None
    first = max(stretch[0], *(c.span_s[0] for c in others))
    # A period ends where the sample after its last one would stand.
    last = min(stretch[1] + step, *(c.span_s[1] + 1.0 / c.rate_hz for c in others))
    first += period * max(1, math.ceil(SETTLE_S / period))
    periods = math.floor((last - first) / period + 1.0e-6)
    if periods < FEWEST_PERIODS:
        raise IdentificationError(
            f"{name}: of {reference.name}, which repeats from {stretch[0]:.2f} to {stretch[1]:.2f} s every "
            f"{period:g} s, {max(periods, 0)} whole periods are left after settling; noise needs "
            f"{FEWEST_PERIODS} to be told from response: repeat the experiment with more periods"
        )
    return Window(first, period, periods)
