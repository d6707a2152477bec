"""What a fit is worth on data that it has not seen: the split, and the shrink of the gap there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hil.gap.fits.fitted import Calibrated, Fit
from hil.gap.floor.noise import NoiseModel
from hil.gap.record.problem import Mask, Problem

Array = NDArray[np.float64]

HELD_SHARE: Final = 0.35
"""Of a lone run: its end is held out."""
LEAST_SEEN: Final = 0.25
"""Share of the gap's energy that fits must see."""
BLOCK_S: Final = 1.0
RESAMPLES: Final = 400
TOUCHED: Final = 0.5
"""Floors by which a fit must change a signal to touch it."""


@dataclass(frozen=True, slots=True)
class Score:
    """Root mean squares on held-out samples, signals in their floors."""

    signals: tuple[str, ...]
    before: float
    after: float
    floor: float
    shrink: float | None
    shrink_ci: tuple[float, float] | None


@dataclass(frozen=True, slots=True)
class Split:
    """What fits may see of each stretch, (from, until) s or None, and in words what is held out."""

    seen: tuple[tuple[float, float] | None, ...]
    text: str

    def train(self, problem: Problem) -> Mask:
        """(N,) samples that fits may see."""
        out = np.zeros(problem.size, dtype=bool)
        for x in problem.series:
            span = self.seen[x.stretch]
            if span is not None:
                t = problem.t_s[x.part]
                out[x.part] = (t >= span[0]) & (t < span[1])
        return out


def split(problem: Problem, noise: NoiseModel, residual: Array) -> Split:
    """Hold out the last of several runs, of a lone one its end; `residual` (N,) of the calibrated twin.

    Where nearly all of the gap stands in what would be held out, fits would have nothing to go by: then
    another run is held out, or the beginning.
    """
    names = [p.name.partition(" (")[0] for p in problem.pieces]
    runs = tuple(dict.fromkeys(names))
    if len(runs) > 1:
        options = [
            Split(
                tuple(None if n == out else (-np.inf, np.inf) for n in names),
                out,
            )
            for out in reversed(runs)
        ]
    else:
        cuts = [
            (p.span_s[0], HELD_SHARE * (p.span_s[1] - p.span_s[0]), p.span_s[1])
            for p in problem.pieces
        ]
        part = f"{100.0 * HELD_SHARE:.0f} % of the record's time"
        options = [
            Split(tuple((-np.inf, end - held) for _, held, end in cuts), f"the last {part}"),
            Split(tuple((start + held, np.inf) for start, held, _ in cuts), f"the first {part}"),
        ]
    energy = (noise.tamed(problem, residual) / noise.sigma) ** 2
    energy = (energy - np.mean((noise.draws / noise.sigma) ** 2, axis=0)) * problem.kept
    shares = [_seen_share(problem, energy, o.train(problem)) for o in options]
    for option, share in zip(options, shares, strict=True):
        if share > LEAST_SEEN:
            return option
    return options[int(np.argmax(shares))]


def _seen_share(problem: Problem, energy: Array, seen: Mask) -> float:
    """Share of the gap's `energy` (N,) in samples that are `seen` (N,), by signals that stand above their
    floor there: what others lie below theirs takes nothing off a gap."""

    def above(mask: Mask) -> float:
        return sum(max(float(energy[x.part] @ mask[x.part]), 0.0) for x in problem.series)

    inside, outside = above(seen), above(~seen)
    return inside / (inside + outside) if inside + outside > 0.0 else 1.0


def traces(c: Calibrated, none: Fit, f: Fit) -> dict[str, float]:
    """By signal, by how many floors (root mean square) a fit changes it."""
    change = c.noise.weighted_rms(c.problem, none.residual - f.residual)
    return {s: change[s] / floor for s, floor in c.floors.items() if floor > 0.0}


def touched(c: Calibrated, none: Fit, f: Fit) -> tuple[str, ...]:
    """Signals that a fit changes by a visible part of their floor."""
    return tuple(s for s, size in traces(c, none, f).items() if size > TOUCHED)


def score(
    problem: Problem,
    noise: NoiseModel,
    before: Array,
    after: Array,
    held: Mask,
    signals: Sequence[str],
    rng: np.random.Generator,
) -> Score:
    """Residuals (N,) `before` and `after` on `held` samples of `signals`; interval by resampled blocks."""
    before, after = noise.tamed(problem, before), noise.tamed(problem, after)
    blocks: dict[tuple[int, int], Array] = {}
    for x in problem.series:
        if x.signal not in signals:
            continue
        rows = held[x.part] & problem.kept[x.part]
        if not rows.any():
            continue
        t = problem.t_s[x.part][rows]
        b = ((t - problem.pieces[x.stretch].span_s[0]) / BLOCK_S).astype(int)
        f2 = noise.sigma[x.part][rows] ** 2
        parts = np.stack(
            [before[x.part][rows] ** 2 / f2, after[x.part][rows] ** 2 / f2,
             np.mean(noise.draws[:, x.part][:, rows] ** 2, axis=0) / f2, np.ones(rows.sum())]
        )  # fmt: skip
        for k in np.unique(b):
            key = (x.stretch, int(k))
            total = parts[:, b == k].sum(axis=1)
            blocks[key] = blocks.get(key, np.zeros(4)) + total
    if not blocks:
        return Score(tuple(signals), 0.0, 0.0, 0.0, None, None)
    table = np.array(list(blocks.values()))
    picks = rng.multinomial(len(table), np.full(len(table), 1.0 / len(table)), RESAMPLES)
    was, now, floor = _rms(table.sum(axis=0)[None])[0]
    floor = min(floor, now)  # what a fit leaves shows that no more than that is noise
    drawn = _rms(picks @ table)
    shrink = _shrink(was, now, floor)
    ci = None
    if shrink is not None:
        values = [_shrink(b, a, min(f, a)) for b, a, f in drawn]
        found = np.array([v for v in values if v is not None])
        if len(found) > RESAMPLES // 2:
            low, high = np.quantile(found, [0.05, 0.95])
            ci = (float(low), float(high))
    return Score(tuple(signals), float(was), float(now), float(floor), shrink, ci)


def _rms(sums: Array) -> Array:
    """(B, 3) from sums of squares and counts (B, 4)."""
    return np.asarray(np.sqrt(sums[:, :3] / sums[:, 3:]))


def _shrink(before: float, after: float, floor: float) -> float | None:
    if before <= 1.05 * floor:
        return None
    return float((before - after) / (before - floor))
