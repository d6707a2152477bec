"""A part of a problem with its noise: the training data by themselves, so that fits replay no more."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from hil.gap.fits.heldout import Split
from hil.gap.floor.noise import NoiseModel
from hil.gap.record.problem import Problem

Index = NDArray[np.int64]


def part_of(problem: Problem, split: Split) -> tuple[Problem, Index]:
    """The stretches of `problem` that `split` lets fits see, and the samples that they are.

    What comes before the seen part of a stretch is replayed, for the twin to come by, and not judged.
    """
    seen = [(k, span) for k, span in enumerate(split.seen) if span is not None]
    kept = [k for k, _ in seen]
    pieces = [problem.sent[k].until(span[1]) for k, span in seen]
    clocks = {(kept.index(k), a): c for (k, a), c in problem.clocks.items() if k in kept}
    small = problem.on(pieces, clocks)
    places = {(x.stretch, x.signal): x.part.start for x in problem.series}
    parts = []
    for x in small.series:
        start = places[kept[x.stretch], x.signal]
        parts.append(np.arange(start, start + x.part.stop - x.part.start))
        small.kept[x.part] &= small.t_s[x.part] >= seen[x.stretch][1][0]
    return small, np.concatenate(parts)


def noise_of(noise: NoiseModel, problem: Problem, small: Problem, rows: Index) -> NoiseModel:
    """The noise of the samples `rows`."""
    terms = {}
    for x, ar, gain in zip(problem.series, noise.ar, noise.gain, strict=True):
        terms[x.part.start] = (ar, gain)
    starts = [int(rows[x.part.start]) for x in small.series]
    return replace(
        noise,
        draws=noise.draws[:, rows],
        sigma=noise.sigma[rows],
        ar=tuple(terms[s][0] for s in starts),
        gain=tuple(terms[s][1] for s in starts),
    )
