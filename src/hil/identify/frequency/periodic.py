"""Periodic records: amplitudes period by period, the excited lines, and the response with its noise."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hil.errors import IdentificationError
from hil.identify.frequency.channels import Channel
from hil.identify.frequency.response import FrequencyResponse, coherence, means, ratio_variance
from hil.identify.frequency.windows import Window

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

RATE_SHARE: Final = 0.4
"""Lines up to this share of the slowest sampling rate are told apart."""
HIGHEST_HZ: Final = 50.0
EXCITED: Final = 1.0e-3
"""A line counts as excited where the cue has this share of its strongest line there [R]."""
VISIBLE: Final = 3.0
"""Amplitude over its standard deviation from which a line is seen."""


@dataclass(frozen=True, slots=True)
class Spectra:
    """Complex amplitudes of P periods at lines 0..K of reference (cue), input and output."""

    window: Window
    reference: ComplexArray
    """(P, K + 1)."""
    input: ComplexArray
    output: ComplexArray
    excited: NDArray[np.int64]
    """Lines that the reference excites."""

    @property
    def hz(self) -> Array:
        """(K + 1,) frequencies of the lines."""
        return np.arange(self.reference.shape[1]) / self.window.period_s


def line_count(channels: Sequence[Channel], period_s: float, highest_hz: float | None) -> int:
    """Lines of the period up to `highest_hz`, or up to what the slowest channel can tell."""
    slowest = min(c.rate_hz for c in channels)
    limit = RATE_SHARE * slowest
    if highest_hz is not None and highest_hz > limit:
        raise IdentificationError(
            f"lines up to {highest_hz:g} Hz are asked for; sampled {slowest:.1f} times a second these "
            f"channels tell lines up to {limit:.1f} Hz"
        )
    count = math.floor(min(limit, highest_hz or HIGHEST_HZ) * period_s + 1e-9)
    if count < 1:
        raise IdentificationError(f"a period of {period_s:g} s has no line below {limit:g} Hz")
    return count


def spectra(
    window: Window, reference: Channel, input_: Channel, output: Channel, count: int
) -> Spectra:
    """Amplitudes of every period at the mean and `count` lines."""

    def of(channel: Channel) -> ComplexArray:
        return np.array([channel.amplitudes(s, window.period_s, count) for s in window.starts()])

    r = of(reference)
    u = r if input_ is reference else of(input_)
    y = u if output is input_ else of(output)
    strength = np.abs(r.mean(axis=0))
    strength[0] = 0.0
    excited = np.flatnonzero(strength > EXCITED * strength.max())
    return Spectra(window, r, u, y, excited)


def respond(s: Spectra, input_: Channel, output: Channel) -> FrequencyResponse:
    """Response at the excited lines from the mean of the periods, noise from their scatter.

    IdentificationError where the output or the input drowns in noise at most lines; single lines that
    do are left out and named in the notes.
    """
    lines, periods = s.excited, s.window.periods
    u, y = s.input[:, lines], s.output[:, lines]
    ym, um, var_y, var_u, cov = means(y, u)
    seen = (np.abs(um) > VISIBLE * np.sqrt(var_u)) & (np.abs(ym) > VISIBLE * np.sqrt(var_y))
    notes = check_seen(seen, s.hz[lines], input_.name, output.name)
    std = np.sqrt(ratio_variance(ym, um, var_y, var_u, cov))
    return FrequencyResponse(
        input_.name,
        output.name,
        f"{output.unit}/{input_.unit}",
        "periodic",
        s.hz[lines][seen],
        (ym / um)[seen],
        std[seen],
        np.full(int(seen.sum()), float(periods - 1)),
        coherence(y, u)[seen],
        notes,
    )


def check_seen(
    seen: NDArray[np.bool_], hz: Array, input_name: str, output_name: str
) -> tuple[str, ...]:
    """Notes on lines that are not seen; IdentificationError where they are more than half."""
    if seen.sum() * 2 < len(seen) or not len(seen):
        raise IdentificationError(
            f"{input_name} to {output_name}: at {len(seen) - seen.sum()} of {len(seen)} excited lines the "
            "motion is not seen above the noise: use a larger amplitude, fewer lines or more periods"
        )
    if seen.all():
        return ()
    lost = ", ".join(f"{f:.3g}" for f in hz[~seen])
    return (f"left out, as not seen above the noise: {lost} Hz",)
