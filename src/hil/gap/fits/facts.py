"""Fits beside facts, seen in values and rows, that each fit holds as well: signals in coarser steps, answers
that never came."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hil.gap.fits.fitted import Calibrated, Fit
from hil.gap.fits.frames import ANSWERS
from hil.gap.fits.frames import EFFECT as LOST
from hil.gap.record.leaf import Leaf, Start
from hil.gap.record.missing import Missing
from hil.gap.record.problem import Mask, Problem

Array = NDArray[np.float64]

EARNED: Final = 5.0
"""Nats that each value on a grid earns, and each answer that is missing: none is by chance."""
EFFECT: Final = "sensor_quantisation"
SHARPEST: Final = 0.05
"""Of a step, how well a value is known at best: as many terms as that asks for tell the steps."""


def is_fact(leaf: Leaf) -> bool:
    """Whether a leaf is read from values or rows, and no question."""
    return leaf.effect == EFFECT or (leaf.effect == LOST and leaf.parameters == (ANSWERS,))


def rounded(c: Calibrated, fits: Sequence[Fit], steps: Mapping[str, float]) -> list[Fit]:
    """The first of `fits`, the twin without effects, then each of them with the steps of the signals."""
    names = tuple(f"{signal}.{EFFECT}.step" for signal in steps)
    leaves = tuple(
        Leaf(EFFECT, signal, (name,), (Start({}, ({name: step},)),), None)
        for (signal, step), name in zip(steps.items(), names, strict=True)
    )
    count = sum(_values_of(c, signal) for signal in steps)
    index = [c.problem.table.index(n) for n in names]
    values = np.array(list(steps.values()))
    out = [fits[0]]
    for f in fits:
        vector = np.array(f.vector)
        vector[index] = values
        out.append(
            replace(
                f, leaves=(*f.leaves, *leaves), names=(*f.names, *names), vector=vector,
                values=np.append(f.values, values), search_sd=np.append(f.search_sd, 1e-3 * values),
                extra_cost=f.extra_cost - EARNED * count,
            )
        )  # fmt: skip
    return out


def left_by(problem: Problem, f: Fit, seen: Mask) -> Array:
    """(N,) residual of a fit; of a signal in steps, what is left of what such steps say on average.

    Which step a value falls on, a twin that is off by a part of one cannot know: rounded itself, it would be
    further off than it was. How far it is off, and how much of the average is there, the samples say that
    fits have `seen` (N,).
    """
    steps = {
        name.removesuffix(f".{EFFECT}.step"): float(value)
        for name, value in zip(f.names, f.values, strict=True) if name.endswith(f".{EFFECT}.step")
    }  # fmt: skip
    vector = np.array(f.vector)
    for x in problem.series:
        if x.signal in steps:
            vector[problem.table.index(f"{x.signal}.{EFFECT}.step")] = 0.0
    left = problem.measured - problem.answers(vector)[0]
    for signal, step in steps.items():
        own = np.zeros(problem.size, dtype=bool)
        for x in problem.series:
            own[x.part] = x.signal == signal
        known = own & seen & problem.kept
        if known.any():
            blur = math.sqrt(max(float(np.mean(left[known] ** 2)) - step**2 / 12.0, 0.0))
            wave = ripple(problem.measured - left, step, blur)
            there = float(left[known] @ wave[known]) / max(float(np.sum(wave[known] ** 2)), 1e-300)
            left[own] -= min(max(there, 0.0), 1.0) * wave[own]
    return np.asarray(left)


def ripple(values: Array, step: float, blur: float) -> Array:
    """What rounding to multiples of `step` adds to `values` (N,) on average, where they are off by `blur`
    (standard deviation, Gaussian): a saw tooth's Fourier series [M]."""
    blur = max(blur / step, SHARPEST)
    turns = 2.0 * np.pi * values / step
    return step * sum(
        ((-1.0) ** k / (np.pi * k) * math.exp(-2.0 * (np.pi * k * blur) ** 2) * np.sin(k * turns)
         for k in range(1, round(1.0 / SHARPEST) + 1)),
        start=np.zeros(len(values)),
    )  # fmt: skip


def missed(fits: Sequence[Fit], missing: Missing) -> list[Fit]:
    """`fits`, the first of them the twin without effects, with the share of answers that are missing in those
    that have lost frames; where it is a finding, the first and then each of them with it."""
    leaf = Leaf(LOST, "bus", (ANSWERS,), (Start({}, ()),), None)
    sd = math.sqrt(missing.share / max(missing.slots, 1))
    out = [fits[0]] if missing.is_finding else []
    for f in fits:
        has = f
        if missing.is_finding and ANSWERS not in f.names:
            has = replace(
                f, leaves=(*f.leaves, leaf), names=(*f.names, ANSWERS),
                values=np.append(f.values, 0.0), search_sd=np.append(f.search_sd, 0.0),
            )  # fmt: skip
        mine = np.array(has.names) == ANSWERS
        earned = EARNED * missing.count if missing.is_finding else 0.0
        out.append(
            replace(
                has, values=np.where(mine, missing.share, has.values),
                search_sd=np.where(mine, sd, has.search_sd), extra_cost=has.extra_cost - earned,
            )
        )  # fmt: skip
    return out


def _values_of(c: Calibrated, signal: str) -> int:
    """Values of a signal that fits see; of one that drives the twin of a ride, as many as of another."""
    counts = [(x.signal, int(c.train[x.part].sum())) for x in c.problem.series]
    own = sum(count for s, count in counts if s == signal)
    return own or max(count for _, count in counts)
