"""A second-order low-pass with delay, fitted to a frequency response by weighted least squares.

G(s) = k e^(-τs) / (1 + 2ζ s/ω + s²/ω²), times what is known beforehand (the drives). With ζ = 1 it is the
platform filter of "Towards Simulating a Mid-size Stewart Platform on a Large Hexapod Simulator", (1).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.stats import t as student

from hil.errors import IdentificationError
from hil.identify.frequency.response import CONFIDENCE, FrequencyResponse

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

NAMES: Final = ("gain", "frequency", "damping", "delay")
UNITS: Final = {"gain": "", "frequency": "Hz", "damping": "", "delay": "s"}
SMALLEST_STD: Final = 1.0e-4
"""Relative: exact data must not make one line outweigh all others."""
HIGHEST: Final = 30.0
"""Break frequencies up to so many times the highest line: beyond, a pole is a delay."""
DAMPINGS: Final = (0.02, 5.0)
DELAYS: Final = 60
FREQUENCIES: Final = 24
TELLS: Final = 0.5
"""A parameter whose interval is wider than this share of its value is not told by these data."""


@dataclass(frozen=True, slots=True)
class Estimate:
    """One parameter: value, standard deviation and 95 % interval, SI (frequency in Hz)."""

    value: float
    std: float
    interval: tuple[float, float]
    unit: str
    is_told: bool
    """False where the interval is too wide, or the value at a bound, to mean anything."""


@dataclass(frozen=True, slots=True)
class SecondOrderFit:
    """The fitted model."""

    parameters: Mapping[str, Estimate]
    hz: Array
    model: ComplexArray
    """(F,) fitted response at these lines, with what was known beforehand."""
    misfit: float
    """Root mean square of residual over its standard deviation: 1 where the model is right."""

    @property
    def low_frequency_delay_s(self) -> float:
        """Lag of slow motion behind the reference: τ + 2ζ/ω, s."""
        p = self.parameters
        omega = 2.0 * np.pi * p["frequency"].value
        return float(p["delay"].value + 2.0 * p["damping"].value / omega)


def second_order(
    hz: Array, gain: float, frequency_hz: float, damping: float, delay_s: float
) -> ComplexArray:
    """Response (F,) of the model."""
    x = hz / frequency_hz
    turn = np.exp(-2j * np.pi * hz * delay_s)
    return np.asarray(gain * turn / (1.0 - x * x + 2j * damping * x))


def fit_second_order(
    response: FrequencyResponse,
    known: ComplexArray | None = None,
    fixed: Mapping[str, float] | None = None,
) -> SecondOrderFit:
    """Fit gain, frequency (Hz), damping and delay (s); `fixed` holds some of them, `known` (F,) is a factor.

    Each line weighs by its standard deviation. Intervals are Student's, widened where the residuals are
    larger than the noise says: a wrong model must not look sure. IdentificationError with too few lines.
    """
    hz = response.hz
    factor = np.ones(len(hz), dtype=complex) if known is None else known
    fixed = dict(fixed or {})
    free = [n for n in NAMES if n not in fixed]
    freedom = 2 * len(hz) - len(free)
    if freedom < 2:
        raise IdentificationError(
            f"{len(hz)} lines cannot tell {', '.join(free)}: excite at least {len(free) // 2 + 2}"
        )
    sigma = np.maximum(response.std, SMALLEST_STD * np.abs(response.value)) / np.sqrt(2.0)

    def values(x: Array) -> list[float]:
        given = dict(zip(free, x, strict=True))
        return [float(fixed.get(n, given.get(n, 0.0))) for n in NAMES]

    def residual(x: Array) -> Array:
        left = (second_order(hz, *values(x)) * factor - response.value) / sigma
        return np.concatenate([left.real, left.imag])

    start = _start(response, factor, fixed, sigma)
    bounds = {
        "gain": (-1e12, 1e12),
        "frequency": (0.1 * hz[0], HIGHEST * hz[-1]),
        "damping": DAMPINGS,
        "delay": (-1.0, 2.0),
    }
    low, high = (np.array([bounds[n][k] for n in free]) for k in (0, 1))
    scale = [max(abs(start[n]), 1e-2) for n in free]
    found = least_squares(
        residual,
        [start[n] for n in free],
        bounds=(low, high),
        x_scale=scale,
        xtol=1e-12,
        ftol=1e-12,
    )
    misfit = float(np.sqrt(2.0 * found.cost / freedom))
    slopes = np.asarray(found.jac)
    covariance = np.linalg.pinv(slopes.T @ slopes) * max(misfit, 1.0) ** 2
    at_bound = (found.x < low + 1e-6 * np.abs(low)) | (found.x > high - 1e-6 * np.abs(high))
    stuck = {n for n, is_at in zip(free, at_bound, strict=True) if is_at}
    reach = float(student.ppf(0.5 + 0.5 * CONFIDENCE, freedom))
    std = dict(zip(free, np.sqrt(np.diag(covariance)), strict=True))
    parameters = {}
    for name, value in zip(NAMES, values(found.x), strict=True):
        half = reach * float(std.get(name, 0.0))
        size = abs(value) if name != "delay" else max(abs(value), 0.1 / float(hz.max()))
        parameters[name] = Estimate(
            value,
            float(std.get(name, 0.0)),
            (value - half, value + half),
            UNITS[name],
            half <= TELLS * size and name not in stuck,
        )
    model = second_order(hz, *values(found.x)) * factor
    return SecondOrderFit(parameters, hz, model, misfit)


def _start(
    response: FrequencyResponse, factor: ComplexArray, fixed: Mapping[str, float], sigma: Array
) -> dict[str, float]:
    """The best of a grid of delays and frequencies, each with its best gain: phases wrap, so descent
    from one guess would end in a wrong valley."""
    hz, g = response.hz, response.value
    damping = fixed.get("damping", 0.8)
    delays = [fixed["delay"]] if "delay" in fixed else np.linspace(0.0, 0.3, DELAYS).tolist()
    frequencies = (
        [fixed["frequency"]]
        if "frequency" in fixed
        else np.geomspace(hz[0], 10.0 * hz[-1], FREQUENCIES).tolist()
    )
    best, best_cost = {"gain": 1.0}, np.inf
    turns = np.exp(-2j * np.pi * np.outer(delays, hz))
    for frequency in frequencies:
        m = turns * (second_order(hz, 1.0, frequency, damping, 0.0) * factor / sigma)
        power = np.sum(np.abs(m) ** 2, axis=1)
        gains = np.real(m.conj() @ (g / sigma)) / power
        gains = np.full(len(gains), fixed["gain"]) if "gain" in fixed else gains
        cost = np.sum(np.abs(gains[:, None] * m - g / sigma) ** 2, axis=1)
        k = int(np.argmin(cost))
        if cost[k] < best_cost:
            best_cost = float(cost[k])
            best = {
                "gain": float(gains[k]),
                "frequency": frequency,
                "damping": damping,
                "delay": float(delays[k]),
            }
    return best
