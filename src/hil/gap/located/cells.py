"""Energy of a residual by signal, band and region, beside the floor's, block by block of time.

Energies are sums of squares over the squared floor of the signal, so that signals with different units
compare. Blocks of time are what intervals are resampled from: samples within one depend on each other,
across signals too; blocks nearly do not.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.stats import gamma

from hil.gap.floor.noise import NoiseModel
from hil.gap.located.bands import bands_hz, split_bands
from hil.gap.record.problem import Problem
from hil.gap.record.regions import DIMENSIONS, Codes

Array = NDArray[np.float64]

BLOCK_S: Final = 1.0
FEWEST_BLOCKS: Final = 8
MOST: Final = 300.0
"""Of a score: beyond it a chance is no number any more."""


@dataclass(frozen=True, slots=True)
class Cells:
    """What each cell (a signal's band, whole or in one region) holds; C cells, J blocks of time."""

    signal: NDArray[np.int64]
    """(C,) index into the problem's signals."""
    band: tuple[tuple[float, float], ...]
    """(C,) Hz."""
    region: tuple[str, ...]
    """(C,) "everywhere" or a region."""
    dimension: tuple[str, ...]
    """(C,) "" for everywhere."""
    energy: Array
    """(C, J) of the residual, in squared floors of the signal."""
    floor: Array
    """(C, J) mean over the draws."""
    spread: Array
    """(C,) standard deviation of the whole cell's energy without a gap."""
    samples: Array
    """(C,) judged samples of the cell."""
    dwell_s: Array
    """(C,) mean time that the rig stays in the region at a visit."""

    @property
    def excess(self) -> Array:
        """(C, J) energy above the floor."""
        return self.energy - self.floor

    @property
    def score(self) -> Array:
        """(C,) -log10 of the chance that noise alone makes a cell's energy.

        Energies of noise are sums of squares, so gamma distributed with the mean and spread of the draws:
        a slow band of a short record has few degrees of freedom and a long tail.
        """
        mean = np.maximum(self.floor.sum(axis=1), 1e-12)
        variance = np.maximum(self.spread**2, 1e-12 * mean**2)
        chance = gamma.logsf(self.energy.sum(axis=1), mean**2 / variance, scale=variance / mean)
        return np.asarray(np.minimum(-chance / np.log(10.0), MOST))


def block_s(problem: Problem) -> float:
    """Length of the blocks: 1 s, less only where that would leave too few."""
    spans = [p.span_s[1] - p.span_s[0] for p in problem.pieces]
    return min(BLOCK_S, sum(spans) / FEWEST_BLOCKS)


def count_cells(
    problem: Problem,
    noise: NoiseModel,
    residual: Array,
    codes: Sequence[Mapping[str, Codes]],
) -> Cells:
    """Energies of `residual` (N,) and of the draws of `noise`."""
    floor = noise.floor(problem)
    length = block_s(problem)
    firsts = np.cumsum(
        [0] + [int((p.span_s[1] - p.span_s[0]) / length) + 1 for p in problem.pieces]
    )
    blocks = int(firsts[-1])
    table: dict[tuple[int, tuple[float, float], str, str], list[Array]] = {}
    visits: dict[tuple[int, str], list[tuple[float, int]]] = {}
    for x, regions in zip(problem.series, codes, strict=True):
        kept = problem.kept[x.part]
        if kept.sum() < 8:
            continue
        t = problem.t_s[x.part][kept]
        step = _step_s(problem, x.signal)
        rows = np.vstack([residual[x.part][kept], noise.draws[:, x.part][:, kept]])
        parts = split_bands(t, rows / floor[x.signal], step) ** 2
        at = ((t - problem.pieces[x.stretch].span_s[0]) / length).astype(np.int64)
        at += firsts[x.stretch]
        s = problem.signals.index(x.signal)
        everywhere = {"": np.zeros(len(t), dtype=np.int64)}
        for dimension, code in {**everywhere, **{d: c[kept] for d, c in regions.items()}}.items():
            names = DIMENSIONS[dimension] if dimension else ("everywhere",)
            inside = code >= 0
            place = at[inside] * len(names) + code[inside]
            size = blocks * len(names)
            counts = np.bincount(place, minlength=size).reshape(blocks, len(names))
            for r, name in enumerate(names):
                inner = code == r
                entries = int(np.sum(np.diff(np.concatenate([[0], inner.astype(np.int8)])) > 0))
                visits.setdefault((s, name), []).append((step * float(inner.sum()), entries))
            for k, band in enumerate(bands_hz(step)):
                sums = np.array(
                    [np.bincount(place, r[inside], size).reshape(blocks, -1) for r in parts[k]]
                )
                for r, name in enumerate(names):
                    cell = np.vstack([sums[:, :, r], counts[None, :, r]])
                    key = (s, band, dimension, name)
                    if key in table:
                        table[key].append(cell)
                    else:
                        table[key] = [cell]
    keys = [k for k, v in table.items() if sum(c[-1].sum() for c in v) > 0]
    stack = np.array([np.sum(table[k], axis=0) for k in keys])
    drawn = stack[:, 1:-1]
    return Cells(
        np.array([k[0] for k in keys]),
        tuple(k[1] for k in keys),
        tuple(k[3] for k in keys),
        tuple(k[2] for k in keys),
        stack[:, 0],
        drawn.mean(axis=1),
        _spread(drawn),
        stack[:, -1].sum(axis=1),
        np.array([_dwell_s(visits[k[0], k[3]]) for k in keys]),
    )


def _dwell_s(visits: list[tuple[float, int]]) -> float:
    return sum(s for s, _ in visits) / max(sum(n for _, n in visits), 1)


def _spread(drawn: Array) -> Array:
    """(C,) standard deviation of a cell's total (C, D, J) without a gap.

    Blocks vary about their mean over the draws independently of each other, and the level of the whole
    may be off: the larger of both views counts.
    """
    by_block = np.sqrt(np.sum(drawn.var(axis=1, ddof=1), axis=1))
    whole = drawn.sum(axis=2).std(axis=1, ddof=1)
    return np.asarray(np.maximum(by_block, whole))


def _step_s(problem: Problem, signal: str) -> float:
    steps = [np.median(np.diff(problem.t_s[x.part])) for x in problem.series if x.signal == signal]
    return float(np.median(steps))
