"""Where a fit of candidates starts: what a start and the amplitudes of its columns mean as parameters."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hil.gap.catalogue.bank import ABSOLUTE
from hil.gap.fits.fitted import Calibrated, Fit
from hil.gap.record.leaf import Changes, Leaf
from hil.gap.record.problem import Problem

Array = NDArray[np.float64]

WAVE: Final = (".amplitude", ".phase")


def _wave(columns: Sequence[Changes], amplitudes: Array) -> dict[str, float]:
    """Amplitude and phase of a sine and, a quarter turn before it, a cosine."""
    amplitude, phase = sorted(columns[0])
    a, b = (float(x) for x in amplitudes)
    return {
        amplitude: columns[0][amplitude] * float(np.hypot(a, b)),
        phase: float(np.arctan2(b, a)),
    }


def changes_of(
    leaves: Sequence[Leaf], starts: Sequence[tuple[int, Array]], problem: Problem
) -> Changes:
    """Start values of a fit: each leaf's start number, and amplitudes of its columns."""
    out: dict[str, float] = {}
    for leaf, (s, amplitudes) in zip(leaves, starts, strict=True):
        start = leaf.starts[s]
        out.update(start.fixed)
        if len(start.columns) == 2 and all(n.endswith(WAVE) for c in start.columns for n in c):
            out.update(_wave(start.columns, amplitudes))
            continue
        for column, a in zip(start.columns, amplitudes, strict=True):
            for name, value in column.items():
                p = problem.table[name]
                neutral = p.to_search(p.neutral)
                now = p.to_search(out[name]) if name in out else neutral
                step = p.to_search(value) - neutral
                out[name] = p.from_search(now + float(a) * step)
        for name in leaf.parameters:
            if name in out:
                p = problem.table[name]
                out[name] = min(max(out[name], p.lower), p.upper)
    return out


def relative(c: Calibrated, f: Fit) -> dict[str, float]:
    """Values of fitted parameters as starts give them: for a twin without effects."""
    out = {}
    for name, value in zip(f.names, f.values.tolist(), strict=True):
        p = c.problem.table[name]
        now = float(c.vector[c.problem.table.index(name)])
        is_added = p.search == "linear" and np.isfinite(p.neutral) and p.parameter not in ABSOLUTE
        out[name] = value - now + p.neutral if is_added else value
    return out | chosen(c.problem, f)


def chosen(problem: Problem, f: Fit) -> dict[str, float]:
    """Values other than neutral of what a fit's effects have that is chosen and never fitted."""
    own = [problem.table[n] for leaf in f.leaves for n in leaf.parameters]
    values = {p.name: float(f.vector[problem.table.index(p.name)]) for p in own if p.scale == 0.0}
    return {n: v for n, v in values.items() if v != problem.table[n].neutral}
