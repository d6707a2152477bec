"""What sinusoids tell of a motion system: describing function, noise by kind, reversal bump, hysteresis.

After AGARD Advisory Report 144, "Dynamic Characteristics of Flight Simulator Motion Systems" (1979), the
definitions as `docs/describing-functions.md` has them in our words [M].
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hil.errors import IdentificationError
from hil.identify.frequency.acceleration import Acceleration
from hil.identify.frequency.channels import Channel, Sampled
from hil.identify.frequency.harmonics import waveform
from hil.identify.frequency.periodic import line_count
from hil.identify.frequency.windows import Window

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

PURE: Final = 0.995
"""Share of the cue's power in its fundamental from which it is a sinusoid."""
LOW: Final = 3
"""Harmonics up to this one are low-frequency nonlinearity, those above are roughness [M]."""
HIGHEST_HZ: Final = 80.0
REVERSAL: Final = 1.0 / 12.0
"""Part of a period on either side of a reversal in which its bump is looked for."""
GRID: Final = 2048


@dataclass(frozen=True, slots=True)
class SineMeasures:
    """One sinusoid of one coordinate. Accelerations in `unit`, standard deviations unless named peaks."""

    run: str
    coordinate: str
    unit: str
    source: str
    hz: float
    amplitude: float
    """Of the cue, m or rad."""
    commanded: float
    """Amplitude of the cue's acceleration."""
    describing: complex
    """Fundamental of the acceleration over that of the cue's."""
    describing_std: float
    fundamental: float
    """Amplitude of the measured acceleration's fundamental."""
    stochastic: float
    """What does not repeat from period to period; NaN where no IMU tells."""
    low_frequency: float
    """Harmonics 2 and 3."""
    high_frequency: float
    """Harmonics from 4 on, as far as the sampling tells them."""
    peak: float
    """Largest deviation of a sample from the fundamental; NaN without an IMU."""
    reversal_bump: float
    """Peak to peak of the repeating deviation near the two reversals of the speed."""
    hysteresis: float
    """Width of the loop of pose over setpoints at the middle of the stroke, m or rad; with lag times twice
    the speed."""
    peak_speed: float
    """Of the measured pose's fundamental, m/s or rad/s."""

    @property
    def noise(self) -> float:
        """All that is not the fundamental, standard deviation."""
        parts = (self.stochastic, self.low_frequency, self.high_frequency)
        return math.sqrt(sum(p * p for p in parts if not math.isnan(p)))

    @property
    def noise_ratio(self) -> float:
        """`noise` over the standard deviation of the fundamental."""
        return self.noise / (self.fundamental / math.sqrt(2.0))


def measure_sine(
    run: str,
    coordinate: str,
    window: Window,
    cue: Channel,
    setpoint: Channel | None,
    pose: Channel,
    felt: Acceleration,
) -> SineMeasures:
    """All measures of one sinusoid; IdentificationError where the cue is none."""
    period_s = window.period_s
    count = line_count((felt.channel,), period_s, None)
    count = min(count, int(HIGHEST_HZ * period_s)) if felt.order < 2 else count
    slow = line_count((cue, pose), period_s, None)
    starts = window.starts()
    r = np.array([cue.amplitudes(s, period_s, slow) for s in starts]).mean(axis=0)
    power = float(np.sum(np.abs(r[1:]) ** 2))
    if np.abs(r[1]) ** 2 < PURE * power or count < LOW + 1:
        share = np.abs(r[1]) ** 2 / power
        raise IdentificationError(
            f"{run}: cue.{coordinate} is no sinusoid: {share:.1%} of its power is in its fundamental"
        )
    omega = 2.0 * np.pi / period_s
    a = np.array([felt.harmonics(s, period_s, count) for s in starts])
    mean = a.mean(axis=0)
    spread = np.sum(np.abs(a - mean) ** 2, axis=0) / (len(a) - 1) / len(a)
    asked = -omega * omega * r[1]
    parts = 0.5 * (np.abs(mean) ** 2 - spread)
    stochastic, peak = _scatter(felt, window, mean)
    q = np.array([pose.amplitudes(s, period_s, slow) for s in starts]).mean(axis=0)
    loop = q
    if setpoint is not None:
        u = np.array([setpoint.amplitudes(s, period_s, slow) for s in starts]).mean(axis=0)
        width = _loop_width(u, loop)
    else:
        width = float("nan")
    return SineMeasures(
        run,
        coordinate,
        felt.unit,
        felt.source,
        1.0 / period_s,
        float(np.abs(r[1])),
        float(np.abs(asked)),
        complex(mean[1] / asked),
        float(np.sqrt(spread[1]) / np.abs(asked)),
        float(np.abs(mean[1])),
        stochastic,
        math.sqrt(max(float(np.sum(parts[2 : LOW + 1])), 0.0)),
        math.sqrt(max(float(np.sum(parts[LOW + 1 :])), 0.0)),
        peak,
        _bump(mean),
        width,
        float(omega * np.abs(q[1])),
    )


def _scatter(felt: Acceleration, window: Window, mean: ComplexArray) -> tuple[float, float]:
    """Standard deviation about the repeating part, and the largest deviation from the fundamental."""
    if not isinstance(felt.channel, Sampled):
        return float("nan"), float("nan")
    c, period_s = felt.channel, window.period_s
    inside = (c.t_s >= window.start_s) & (c.t_s < window.start_s + window.periods * period_s)
    t, x = c.t_s[inside], c.value[inside]
    if felt.order:
        x = np.gradient(x, t)
    lines = np.arange(len(mean))
    turn = np.exp(2j * np.pi / period_s * np.outer(t - window.start_s, lines))
    repeating = (turn * mean).real.sum(axis=1)
    left = x - x.mean() - repeating
    freedom = max(len(t) - 2 * len(mean) + 1, 1)
    fundamental = (turn[:, 1] * mean[1]).real
    return (
        math.sqrt(float(np.sum(left**2)) / freedom),
        float(np.max(np.abs(x - x.mean() - fundamental))),
    )


def _bump(mean: ComplexArray) -> float:
    """Peak to peak of what repeats beside the fundamental, near the zeros of the fundamental's speed.

    The speed of the motion is the integral of the acceleration, so it reverses where the fundamental of
    the acceleration peaks.
    """
    rest = mean.copy()
    rest[1] = 0.0
    size = max(GRID, 4 * len(mean))
    deviation = waveform(rest, size)
    first = -np.angle(mean[1]) / (2.0 * np.pi)
    half = int(REVERSAL * size)
    peaks = []
    for reversal in (first, first + 0.5):
        at = round(reversal * size)
        near = deviation[np.arange(at - half, at + half + 1) % size]
        peaks.append(float(np.ptp(near)))
    return max(peaks)


def _loop_width(u: ComplexArray, q: ComplexArray) -> float:
    """|q going up - q going down| where the input's fundamental passes its middle."""
    size = max(GRID, 4 * len(q))
    turn = np.exp(-1j * np.arange(len(q)) * np.angle(u[1]))
    wave = waveform(q * turn, size)  # the input is now a cosine: middle at a quarter and at three
    return float(abs(wave[size // 4] - wave[3 * size // 4]))
