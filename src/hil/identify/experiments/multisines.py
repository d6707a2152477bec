"""Random-phase multisines on chosen lines: the signals that tell noise, even and odd distortion apart.

With several periods noise is what differs between periods; with several random-phase realisations
distortion is what differs between realisations; on lines that stay empty distortion is seen directly
(R. Pintelon and J. Schoukens, "System Identification: A Frequency Domain Approach" [M]).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hil.config import RigFile
from hil.errors import ConfigError
from hil.identify.experiments.description import Lines, Segment
from hil.identify.experiments.plans import Multisine
from hil.identify.experiments.shapes import Grid, Shape, chosen, placed, preferred, sized
from hil.identify.experiments.signals import Array, Motion, carried_on, faded, multisine

Harmonics = NDArray[np.int64]
_POWER = {"position": 0, "velocity": 1, "acceleration": 2}


@dataclass(frozen=True, slots=True)
class LineChoice:
    """Multiples of 1/period: excited ones of each coordinate, and those of the band that stay empty."""

    excited: tuple[Harmonics, ...]
    detection: Harmonics


def choose_lines(plan: Multisine, period_s: float, coordinates: int) -> LineChoice:
    """Lines of the plan, dealt out in turn to the coordinates so that they share none (zippered).

    ConfigError where a coordinate would get none.
    """
    lowest = max(1, int(np.ceil(plan.f_min * period_s - 1.0e-9)))
    highest = int(np.floor(plan.f_max * period_s + 1.0e-9))
    if plan.harmonics:
        lines = np.unique(np.array(plan.harmonics, dtype=np.int64))
        lowest, highest = int(lines[0]), int(lines[-1])
    else:
        lines = np.arange(lowest, highest + 1, dtype=np.int64)
        if plan.lines != "full":
            lines = lines[lines % 2 == 1]
        if plan.lines == "odd_random":
            lines = _without_one_a_group(lines, plan.group, plan.phase_seed)
    if len(lines) < coordinates:
        raise ConfigError(
            f"multisine: {len(lines)} lines between {plan.f_min:g} and {plan.f_max:g} Hz are too few "
            f"for {coordinates} coordinates: lengthen period_s ({period_s:g} s) or widen the band"
        )
    band = np.arange(lowest, highest + 1, dtype=np.int64)
    return LineChoice(
        tuple(lines[k::coordinates] for k in range(coordinates)), np.setdiff1d(band, lines)
    )


def multisine_shape(plan: Multisine, rig: RigFile) -> Shape:
    """All realisations one after the other, each faded in and out, with rest between."""
    grid = Grid(rig)
    period_s = grid.seconds(plan.period_s)
    grid.seconds(plan.realisations * (plan.settle_periods + plan.periods) * period_s)
    steps, fade = grid.steps(period_s), grid.steps(plan.fade_s)
    moving = chosen(plan, rig, [preferred(rig)])
    choice = choose_lines(plan, period_s, len(moving))
    _check_nyquist(choice, period_s, rig)
    streams = np.random.default_rng([plan.phase_seed, 1]).spawn(plan.realisations)
    draws = [
        [_drawn(lines, plan, steps, grid.step_s, rng) for lines in choice.excited]
        for rng in streams
    ]
    peaks = [max(np.max(np.abs(draw[k].p)) for draw in draws) for k in range(len(moving))]
    whole = (plan.settle_periods + plan.periods) * steps + 2 * fade + 1
    rest = grid.rest(np.zeros((1, len(moving))))
    rows, segments = [rest], []
    for number, draw in enumerate(draws):
        begin_s = sum(map(len, rows)) / grid.rate_hz + fade * grid.step_s
        begin_s += plan.settle_periods * period_s
        segments.append(
            Segment(
                name=f"realisation {number + 1}",
                start_s=round(begin_s, 9),
                end_s=round(begin_s + plan.periods * period_s, 9),
                periods=plan.periods,
                realisation=number,
            )
        )
        columns = [faded(carried_on(m, -fade, whole), fade, fade) for m in draw]
        rows += [np.column_stack([grid.rows(m) for m in columns]) / peaks, rest]
    units = np.concatenate(rows)
    amplitude = sized(rig, moving, plan.amplitude, units, grid.rate_hz)
    full = placed(rig, moving, units, amplitude)
    lines = tuple(
        Lines(coordinate=c, excited=tuple(excited.tolist()))
        for c, excited in zip(moving, choice.excited, strict=True)
    )
    return Shape(
        moving,
        amplitude,
        lambda s: s * full,
        tuple(segments),
        period_s,
        lines,
        tuple(choice.detection.tolist()),
        is_relative=not plan.amplitude,
    )


def crest_factor(motion: Motion) -> float:
    """Largest peak over root mean square among position, speed and acceleration."""
    return max(
        float(np.max(np.abs(x)) / np.sqrt(np.mean(x**2))) for x in (motion.a, motion.v, motion.p)
    )


def _drawn(
    lines: Harmonics, plan: Multisine, steps: int, step_s: float, rng: np.random.Generator
) -> Motion:
    """The draw of random phases with the smallest crest factor."""
    amplitudes: Array = 1.0 / lines.astype(np.float64) ** _POWER[plan.spectrum]
    tried = (
        multisine(lines, amplitudes, rng.uniform(0.0, 2.0 * np.pi, len(lines)), steps, step_s)
        for _ in range(plan.draws)
    )
    return min(tried, key=crest_factor)


def _without_one_a_group(lines: Harmonics, group: int, seed: int) -> Harmonics:
    rng = np.random.default_rng([seed, 0])
    whole = len(lines) // group
    dropped = np.arange(whole) * group + rng.integers(0, group, whole)
    return np.delete(lines, dropped)


def _check_nyquist(choice: LineChoice, period_s: float, rig: RigFile) -> None:
    highest = max(int(lines[-1]) for lines in choice.excited) / period_s
    bound = 0.25 / rig.bus.cycle
    if highest > bound:
        raise ConfigError(
            f"multisine: a line at {highest:g} Hz lies above {bound:g} Hz, a quarter of the rate of "
            f"setpoints: {rig.name} cannot be asked for it"
        )
