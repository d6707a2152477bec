"""A second-order low-pass with delay, fitted to a frequency response by weighted least squares.

G(s) = k e^(-τs) / (1 + 2ζ s/ω + s²/ω²), times what is known beforehand (the drives). With ζ = 1 it is the
platform filter of "Towards Simulating a Mid-size Stewart Platform on a Large Hexapod Simulator", (1).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq, least_squares, leastsq
from scipy.stats import t as student

from hil.errors import IdentificationError
from hil.identify.frequency.line_noise import steadied
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
PROFILED: Final = 1.0e-8
ENDS: Final = 0.003
"""Relative tolerances: of the fits behind an interval, and of its ends."""
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

    Each line weighs by its standard deviation, `steadied` first. Intervals are where the profile of the
    likelihood falls by Student's t, widened where the residuals are larger than the noise says: a wrong
    model must not look sure. IdentificationError with too few lines.
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
    sigma = np.maximum(steadied(response), SMALLEST_STD * np.abs(response.value)) / np.sqrt(2.0)
    problem = _Problem(response, factor, sigma)
    best = problem.solve(_start(response, factor, fixed, sigma) | fixed, free)
    misfit = float(np.sqrt(2.0 * best.cost / freedom))
    std = problem.std(best.values, free)
    reach = float(student.ppf(0.5 + 0.5 * CONFIDENCE, freedom))
    parameters = {}
    for name, value in best.values.items():
        if name in fixed:
            parameters[name] = Estimate(value, 0.0, (value, value), UNITS[name], True)
            continue
        own = max(misfit, 1.0) * std[name]
        low, high = (
            problem.end(best, free, name, sign, reach * max(misfit, 1.0), reach * own)
            for sign in (-1.0, 1.0)
        )
        size = abs(value) if name != "delay" else max(abs(value), 0.1 / float(hz.max()))
        is_told = 0.5 * (high - low) <= TELLS * size and not problem.is_at_bound(name, value)
        parameters[name] = Estimate(value, own, (low, high), UNITS[name], is_told)
    model = second_order(hz, *best.values.values()) * factor
    return SecondOrderFit(parameters, hz, model, misfit)


@dataclass(frozen=True, slots=True)
class _Best:
    values: Mapping[str, float]
    """In the order of `NAMES`."""
    cost: float
    """Half the sum of squares of residual over its standard deviation."""


class _Problem:
    """Weighted residuals of one response, minimised over some of the parameters."""

    def __init__(self, response: FrequencyResponse, factor: ComplexArray, sigma: Array) -> None:
        self._hz, self._value = response.hz, response.value
        self._factor, self._sigma = factor, sigma
        self._bounds = {
            "gain": (-1e12, 1e12),
            "frequency": (0.1 * response.hz[0], HIGHEST * response.hz[-1]),
            "damping": DAMPINGS,
            "delay": (-1.0, 2.0),
        }

    def solve(self, start: Mapping[str, float], free: Sequence[str]) -> _Best:
        """The least cost within the bounds, from `start` over `free`; the other parameters stay."""
        at = {n: float(start[n]) for n in NAMES}
        low, high = (np.array([self._bounds[n][k] for n in free]) for k in (0, 1))

        def residual(x: Array) -> Array:
            return self._residual(at | dict(zip(free, x.tolist(), strict=True)))

        def slopes(x: Array) -> Array:
            return self._slopes(at | dict(zip(free, x.tolist(), strict=True)), free)

        found = least_squares(
            residual,
            np.clip([at[n] for n in free], low, high),
            slopes,
            bounds=(low, high),
            x_scale=[max(abs(at[n]), 1e-2) for n in free],
            xtol=1e-12,
            ftol=1e-12,
        )
        return _Best(at | dict(zip(free, found.x.tolist(), strict=True)), float(found.cost))

    def _profiled(self, at: Mapping[str, float], free: Sequence[str]) -> _Best:
        """The same from near by, without bounds (MINPACK is much faster), frequency by its logarithm."""
        if not free:
            return _Best(at, 0.5 * float(np.sum(self._residual(at) ** 2)))
        is_log = np.array([n == "frequency" for n in free])

        def values(x: Array) -> dict[str, float]:
            plain = np.where(is_log, np.exp(np.clip(x, -50.0, 50.0)), x)
            return {**at, **dict(zip(free, plain.tolist(), strict=True))}

        def slopes(x: Array) -> Array:
            there = values(x)
            return self._slopes(there, free) * np.where(is_log, [there[n] for n in free], 1.0)

        start = [
            float(np.log(at[n])) if log else at[n] for n, log in zip(free, is_log, strict=True)
        ]

        def residual(x: Array) -> Array:
            return self._residual(values(x))

        # With its full output it does not warn where it stops early: an end is then too near, by little.
        found = leastsq(
            residual, start, Dfun=slopes, full_output=True, ftol=PROFILED, xtol=PROFILED
        )
        there = values(np.asarray(found[0], dtype=np.float64))
        return _Best(there, 0.5 * float(np.sum(self._residual(there) ** 2)))

    def _residual(self, values: Mapping[str, float]) -> Array:
        left = second_order(self._hz, *values.values()) * self._factor - self._value
        return _parts(np.asarray(left / self._sigma))

    def std(self, values: Mapping[str, float], free: Sequence[str]) -> dict[str, float]:
        """Standard deviations by linearisation, with the residuals as the noise says."""
        slopes = self._slopes(values, free)
        covariance = np.linalg.pinv(slopes.T @ slopes)
        return dict(zip(free, np.sqrt(np.diag(covariance)).tolist(), strict=True))

    def is_at_bound(self, name: str, value: float) -> bool:
        """Whether a value lies where the search ends."""
        low, high = self._bounds[name]
        return bool(value <= low + 1e-6 * abs(low) or value >= high - 1e-6 * abs(high))

    def end(
        self, best: _Best, free: Sequence[str], name: str, sign: float, rise: float, guess: float
    ) -> float:
        """Where the profile of `name` is `rise` standard deviations above its minimum, to one side.

        The search's bound where it does not get there: these data set no end.
        """
        others = [n for n in free if n != name]
        bound = self._bounds[name][1 if sign > 0.0 else 0]
        room = abs(bound - best.values[name])
        last = best.values
        # Steps that were asked already: from elsewhere one may find a lower valley than at first.
        known: dict[float, float] = {}

        def above(step: float) -> float:
            nonlocal last
            if step in known:
                return known[step]
            value = best.values[name] + sign * step
            starts = [_along(values, name, value, others) for values in (best.values, last)]
            there = min((self._profiled(x, others) for x in starts), key=lambda x: x.cost)
            last = there.values
            known[step] = float(np.sqrt(2.0 * max(there.cost - best.cost, 0.0))) - rise
            return known[step]

        known[0.0] = -rise
        inner, outer = 0.0, min(max(guess, 1e-12 * max(abs(best.values[name]), 1.0)), room)
        while outer < room and above(outer) < 0.0:
            inner, outer = outer, min(2.0 * outer, room)
        if outer >= room and (room <= 0.0 or above(room) <= 0.0):
            return float(bound)
        last = best.values
        step = float(brentq(above, inner, outer, xtol=ENDS * outer, rtol=ENDS))
        return best.values[name] + sign * step

    def _slopes(self, values: Mapping[str, float], free: Sequence[str]) -> Array:
        """Derivatives (2 F, free) of the weighted residuals."""
        gain, frequency, damping, delay = values.values()
        x = self._hz / frequency
        below = 1.0 - x * x + 2j * damping * x
        unit = second_order(self._hz, 1.0, frequency, damping, delay) * self._factor / self._sigma
        by = {
            "gain": unit,
            "frequency": gain * unit / below * (2j * damping - 2.0 * x) * x / frequency,
            "damping": -gain * unit / below * 2j * x,
            "delay": -2j * np.pi * self._hz * gain * unit,
        }
        return np.stack([_parts(np.asarray(by[n], dtype=complex)) for n in free], axis=1)


def _along(
    values: Mapping[str, float], name: str, value: float, others: Sequence[str]
) -> dict[str, float]:
    """`values` with `name` at `value`: where to look for the best `others`.

    Frequency and damping go together, which keeps the slow lag 2ζ/ω: they lie along that valley.
    """
    moved = {**values, name: value}
    other = {"frequency": "damping", "damping": "frequency"}.get(name, "")
    if other in others and values[name] > 0.0 and value > 0.0:
        moved[other] = values[other] * value / values[name]
    return moved


def _parts(z: ComplexArray) -> Array:
    return np.concatenate([z.real, z.imag])


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
