"""A measured frequency response with its uncertainty, as a value."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray
from scipy.stats import f as fisher

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

Method = Literal["periodic", "realisations", "local polynomial"]
CONFIDENCE: Final = 0.95


@dataclass(frozen=True, slots=True)
class FrequencyResponse:
    """G at F lines. Its errors are taken as circular complex normal."""

    input_name: str
    output_name: str
    unit: str
    """Of the gain, such as "m/m"."""
    method: Method
    hz: Array
    """(F,) rising."""
    value: ComplexArray
    """(F,) output over input."""
    std: Array
    """(F,) sqrt(E|δG|²): with noise only, or with what nonlinearity adds by realisations."""
    freedom: Array
    """(F,) complex degrees of freedom behind `std`."""
    coherence: Array
    """(F,) 0..1: share of the output that is linear in the input, over periods or neighbouring lines."""
    notes: tuple[str, ...] = ()
    extra_std: Mapping[str, Array] = field(default_factory=dict)
    """Parts of the uncertainty, (F,) each, where they are known: "noise", "nonlinear"."""

    @property
    def gain_db(self) -> Array:
        """(F,) 20 log10 |G|."""
        return np.asarray(20.0 * np.log10(np.abs(self.value)))

    @property
    def phase_deg(self) -> Array:
        """(F,) unwrapped along the lines, the first within ±180 deg."""
        return np.degrees(np.unwrap(np.angle(self.value)))

    @property
    def radius(self) -> Array:
        """(F,) of the disc about G that holds the true value with 95 % confidence.

        |δG|²/std² of an estimate with m complex degrees of freedom follows Fisher's F(2, 2m).
        """
        return np.asarray(self.std * np.sqrt(fisher.ppf(CONFIDENCE, 2, 2.0 * self.freedom)))

    @property
    def gain_band_db(self) -> tuple[Array, Array]:
        """Lower and upper 95 % bound of the gain, dB; the lower one at least -120 dB under the value."""
        size = np.abs(self.value)
        low = np.maximum(size - self.radius, 1.0e-6 * size)
        return (
            np.asarray(20.0 * np.log10(low)),
            np.asarray(20.0 * np.log10(size + self.radius)),
        )

    @property
    def phase_band_deg(self) -> tuple[Array, Array]:
        """Lower and upper 95 % bound of the phase, deg; ±180 where the disc holds zero."""
        half = np.degrees(np.arcsin(np.minimum(self.radius / np.abs(self.value), 1.0)))
        half = np.where(self.radius >= np.abs(self.value), 180.0, half)
        return self.phase_deg - half, self.phase_deg + half


def means(
    y: ComplexArray, u: ComplexArray
) -> tuple[ComplexArray, ComplexArray, Array, Array, ComplexArray]:
    """Means (F,) of `y` and `u` (M, F), and the variances and covariance of these means."""
    m = len(y)
    ym, um = y.mean(axis=0), u.mean(axis=0)
    dy, du = y - ym, u - um
    share = 1.0 / (m - 1) / m
    return (
        ym,
        um,
        share * np.sum(np.abs(dy) ** 2, axis=0),
        share * np.sum(np.abs(du) ** 2, axis=0),
        share * np.sum(dy * du.conj(), axis=0),
    )


def coherence(y: ComplexArray, u: ComplexArray) -> Array:
    """Coherence (F,) of `y` and `u` (M, F) over M periods or realisations."""
    power = np.sum(np.abs(y) ** 2, axis=0) * np.sum(np.abs(u) ** 2, axis=0)
    return np.asarray(np.abs(np.sum(y * u.conj(), axis=0)) ** 2 / power)


def ratio_variance(
    output: ComplexArray,
    input_: ComplexArray,
    output_variance: Array,
    input_variance: Array,
    covariance: ComplexArray,
) -> Array:
    """Variance (F,) of output/input, first order; `covariance` is E[δoutput conj(δinput)]."""
    g = output / input_
    spread = (
        output_variance + np.abs(g) ** 2 * input_variance - 2.0 * np.real(g.conj() * covariance)
    )
    return np.asarray(np.maximum(spread, 0.0) / np.abs(input_) ** 2)
