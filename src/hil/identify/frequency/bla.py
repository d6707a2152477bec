"""Best linear approximation: what a nonlinear system does on average, and how far it strays from it.

Two experiments tell (Pintelon and Schoukens, "System Identification: A Frequency Domain Approach" [M]):
- robust: several realisations of a random-phase multisine with one amplitude spectrum. Noise scatters
  from period to period, nonlinearity also from realisation to realisation.
- fast: a multisine that leaves lines out. Even powers of the motion fall on even lines, odd powers on odd
  ones, so what appears on lines that nobody excites is distortion and says of which kind.
In a closed loop both input and output are divided by the reference first, which noise cannot reach.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from hil.errors import IdentificationError
from hil.identify.frequency.channels import Channel
from hil.identify.frequency.periodic import Spectra, check_seen, respond
from hil.identify.frequency.response import FrequencyResponse, coherence, means, ratio_variance

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

ALIKE: Final = 0.99
"""References whose phases a shift in time brings to this mean cosine are one realisation, repeated."""
SHIFTS_PER_LINE: Final = 16
SEEN: Final = 3.0


@dataclass(frozen=True, slots=True)
class DetectionLines:
    """Output amplitudes on D lines that the reference leaves out, in the output's unit."""

    kind: Literal["even", "odd"]
    hz: Array
    level: Array
    """(D,) root mean square over realisations, of each line's amplitude."""
    noise: Array
    """(D,) standard deviation that noise alone gives this amplitude."""

    @property
    def distortion(self) -> float:
        """Root mean square over the lines, what noise explains taken off."""
        power = float(np.mean(self.level**2 - self.noise**2))
        return math.sqrt(max(power, 0.0))

    @property
    def floor(self) -> float:
        """The smallest distortion that would be seen above the noise of so many lines."""
        return math.sqrt(SEEN * float(np.mean(self.noise**2)) / math.sqrt(len(self.hz)))

    @property
    def is_seen(self) -> bool:
        """Whether it stands out of the noise."""
        return self.distortion > self.floor


@dataclass(frozen=True, slots=True)
class Distortion:
    """Levels of one output under one class of excitation, amplitudes in the output's unit."""

    output_name: str
    unit: str
    hz: Array
    """(F,) excited lines."""
    linear: Array
    """(F,) amplitude of the output there."""
    noise: Array
    """(F,) standard deviation of one period's amplitude there by noise."""
    nonlinear: Array | None
    """(F,) standard deviation there from realisation to realisation, noise taken off; None with one."""
    lines: tuple[DetectionLines, ...]
    """Even and odd lines left out inside the band, as far as there are any."""


def merge_repeats(records: Sequence[Spectra], names: Sequence[str]) -> list[Spectra]:
    """Spectra by realisation: records of one reference, shifted in time, become one with more periods.

    IdentificationError names a record whose period or lines are not those of the first.
    """
    merged: list[Spectra] = []
    for s, name in zip(records, names, strict=True):
        _check_class(records[0], s, names[0], name)
        for k, other in enumerate(merged):
            turn = _shift(other.reference.mean(axis=0), s.reference.mean(axis=0), s.excited)
            if turn is not None:
                merged[k] = _stack(other, s, turn)
                break
        else:
            merged.append(s)
    return merged


def _check_class(first: Spectra, s: Spectra, first_name: str, name: str) -> None:
    if abs(s.window.period_s / first.window.period_s - 1.0) > 1e-6:
        raise IdentificationError(
            f"{name}: its period is {s.window.period_s:g} s, that of {first_name} "
            f"{first.window.period_s:g} s: runs are analysed together only if they are of one design"
        )
    if not np.array_equal(s.excited, first.excited):
        ours, theirs = (", ".join(f"{f:.3g}" for f in x.hz[x.excited]) for x in (s, first))
        raise IdentificationError(
            f"{name}: excites other lines than {first_name}: {ours} Hz instead of {theirs} Hz"
        )
    a, b = (np.sqrt(np.mean(np.abs(x.reference[:, x.excited]) ** 2)) for x in (s, first))
    if not 0.8 < a / b < 1.25:
        raise IdentificationError(
            f"{name}: its cue is {a / b:.2f} times as large as that of {first_name}: a nonlinear rig "
            "answers another amplitude otherwise; analyse them apart"
        )


def _shift(a: ComplexArray, b: ComplexArray, lines: NDArray[np.int64]) -> float | None:
    """Angle θ with b_k exp(ikθ) = a_k, rad a line; None where no shift in time makes b a.

    Each line has one vote: phases make a realisation, and the strongest line alone would always agree.
    """
    votes = np.zeros(len(a), dtype=complex)
    votes[lines] = np.exp(1j * np.angle(a[lines] * b[lines].conj()))
    size = SHIFTS_PER_LINE * len(a)
    theta = 2.0 * np.pi * int(np.argmax(np.fft.fft(votes, size).real)) / size
    for _ in range(3):  # phases left over after the coarse shift say the rest, by least squares
        left = np.angle(votes[lines] * np.exp(-1j * lines * theta))
        theta += float(np.sum(lines * left) / np.sum(lines * lines))
    agreement = np.mean((votes[lines] * np.exp(-1j * lines * theta)).real)
    return theta if agreement >= ALIKE else None


def _stack(a: Spectra, b: Spectra, turn: float) -> Spectra:
    rotor = np.exp(1j * np.arange(a.reference.shape[1]) * turn)
    window = replace(a.window, periods=a.window.periods + b.window.periods)
    return replace(
        a,
        window=window,
        reference=np.vstack([a.reference, b.reference * rotor]),
        input=np.vstack([a.input, b.input * rotor]),
        output=np.vstack([a.output, b.output * rotor]),
    )


def best_linear(
    realisations: Sequence[Spectra], input_: Channel, output: Channel
) -> FrequencyResponse:
    """The best linear approximation over all realisations; with one, its response with noise only."""
    if len(realisations) == 1:
        return respond(realisations[0], input_, output)
    lines, m = realisations[0].excited, len(realisations)
    per = [_by_reference(s, lines) for s in realisations]
    y, u = np.array([p[0] for p in per]), np.array([p[1] for p in per])
    var_y, var_u, cov = (sum(np.asarray(p[k]) for p in per) / m**2 for k in (2, 3, 4))
    ym, um, *_ = around = means(y, u)
    noise = np.sqrt(ratio_variance(ym, um, np.real(var_y), np.real(var_u), np.asarray(cov)))
    total = np.sqrt(ratio_variance(*around))
    seen = (np.abs(um) > SEEN * np.sqrt(np.real(var_u))) & (
        np.abs(ym) > SEEN * np.sqrt(np.real(var_y))
    )
    notes = check_seen(seen, realisations[0].hz[lines], input_.name, output.name)
    nonlinear = np.sqrt(np.maximum(total**2 - noise**2, 0.0) * m)
    return FrequencyResponse(
        input_.name,
        output.name,
        f"{output.unit}/{input_.unit}",
        "realisations",
        realisations[0].hz[lines][seen],
        (ym / um)[seen],
        total[seen],
        np.full(int(seen.sum()), float(m - 1)),
        coherence(y, u)[seen],
        notes,
        {"noise": noise[seen], "nonlinear": nonlinear[seen]},
    )


def _by_reference(
    s: Spectra, lines: NDArray[np.int64]
) -> tuple[ComplexArray, ComplexArray, Array, Array, ComplexArray]:
    """Mean output and input over the reference, and variances and covariance of these means."""
    reference = s.reference[:, lines]
    return means(s.output[:, lines] / reference, s.input[:, lines] / reference)


def distortion(
    realisations: Sequence[Spectra], response: FrequencyResponse, output: Channel
) -> Distortion:
    """Levels of linear answer, noise, and distortion by lines left out and by realisations."""
    first = realisations[0]
    lines = np.flatnonzero(np.isin(first.hz, response.hz))
    linear = np.sqrt(
        np.mean([np.abs(s.output[:, lines].mean(axis=0)) ** 2 for s in realisations], axis=0)
    )
    noise = np.sqrt(np.mean([_scatter(s.output[:, lines]) for s in realisations], axis=0))
    strength = np.sqrt(
        np.mean([np.abs(s.input[:, lines].mean(axis=0)) ** 2 for s in realisations], axis=0)
    )
    by_realisation = response.extra_std.get("nonlinear")
    nonlinear = None if by_realisation is None else by_realisation * strength
    kinds: tuple[Literal["even", "odd"], ...] = ("even", "odd")
    found = [_left_out(realisations, response, kind) for kind in kinds]
    return Distortion(
        output.name,
        output.unit,
        response.hz,
        linear,
        noise,
        nonlinear,
        tuple(x for x in found if x is not None),
    )


def _scatter(x: ComplexArray) -> Array:
    """Variance (F,) of one period's amplitude over the periods (P, F)."""
    return np.asarray(np.sum(np.abs(x - x.mean(axis=0)) ** 2, axis=0) / (len(x) - 1))


def _left_out(
    realisations: Sequence[Spectra], response: FrequencyResponse, kind: Literal["even", "odd"]
) -> DetectionLines | None:
    """Lines of one parity inside the band that nobody excites; the linear answer to what little input
    there is on them is taken off."""
    first = realisations[0]
    inside = np.arange(first.excited[0], first.excited[-1] + 1)
    parity = 0 if kind == "even" else 1
    lines = np.setdiff1d(inside[inside % 2 == parity], first.excited)
    if first.window.detection is not None:
        lines = np.intersect1d(lines, first.window.detection)
    if len(lines) < 2:
        return None
    hz = first.hz[lines]
    gain = np.interp(hz, response.hz, response.value.real) + 1j * np.interp(
        hz, response.hz, response.value.imag
    )
    power, noise = np.zeros(len(lines)), np.zeros(len(lines))
    for s in realisations:
        rest = s.output[:, lines] - gain * s.input[:, lines]
        power += np.abs(rest.mean(axis=0)) ** 2 / len(realisations)
        noise += _scatter(rest) / s.window.periods / len(realisations)
    return DetectionLines(kind, hz, np.sqrt(power), np.sqrt(noise))
