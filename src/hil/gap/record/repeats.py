"""Finds where a motion was played again: periods of an experiment, and runs that repeat each other."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hil.errors import IdentificationError
from hil.gap.record.problem import Problem
from hil.identify.replay import Stretch

Array = NDArray[np.float64]
Index = NDArray[np.int64]

SAME: Final = 0.02
"""Motions of repeats differ by no more than this share of their own spread."""
GRID_S: Final = 0.01
SHORTEST_S: Final = 0.5
"""Of a period."""
SOME: Final = 50
"""Samples from which on equal answers are no chance."""
LEAST_MOTION: Final = 1e-4
"""m or rad of spread below which nothing was played."""


@dataclass(frozen=True, slots=True)
class Repeats:
    """Samples of the same phase of the same motion, by signal: flat indices of either."""

    text: str
    pairs: Mapping[str, tuple[Index, Index]]


def find_repeats(problem: Problem) -> list[Repeats]:
    """Every pair of repeats in the stretches of a problem: periods one after the other, run beside run."""
    grids = [_grid(piece) for piece in problem.pieces]
    found = []
    for k, (start_s, told) in enumerate(grids):
        window = _period(told)
        if window is None:
            continue
        first, period, count = window
        begin = start_s + first * GRID_S
        span = (begin, begin + (count - 1) * period * GRID_S)
        text = f"{count} periods of {period * GRID_S:.4g} s in {problem.pieces[k].name}"
        found.append(Repeats(text, _pairs(problem, k, k, span, period * GRID_S)))
    for a in range(len(grids)):
        for b in range(a + 1, len(grids)):
            lag = _lag(grids[a][1], grids[b][1])
            if lag is None:
                continue
            shift_s = grids[b][0] - grids[a][0] + lag * GRID_S
            span = problem.pieces[a].span_s
            text = f"{problem.pieces[b].name} repeats {problem.pieces[a].name}"
            pairs = _pairs(problem, a, b, span, shift_s)
            if _is_copy(problem, pairs):
                raise IdentificationError(
                    f"{problem.pieces[a].name} and {problem.pieces[b].name} hold the very same answers: "
                    "noise never repeats itself, so this is one record given twice"
                )
            found.append(Repeats(text, pairs))
    return [r for r in found if r.pairs]


def _is_copy(problem: Problem, pairs: Mapping[str, tuple[Index, Index]]) -> bool:
    """Whether all answers of two repeats are the same, though they change."""
    both = [(problem.measured[a], problem.measured[b]) for a, b in pairs.values()]
    moves = any(len(a) > SOME and float(np.ptp(a)) > 0.0 for a, _ in both)
    return moves and all(np.array_equal(a, b) for a, b in both)


def _grid(piece: Stretch) -> tuple[float, Array]:
    """Start and motion of all actuators (M, n) on a common grid: setpoints, or what was measured where those
    are forces, which are never alike twice and say little of where a rig is."""
    told = piece.setpoints
    if piece.mode == "force":
        told = {a: piece.samples.get(f"{a}.position", s) for a, s in told.items()}
    start = min(t[0] for t, _ in told.values())
    end = max(t[-1] for t, _ in told.values())
    t = np.arange(start, end, GRID_S)
    return start, np.stack([np.interp(t, *s) for s in told.values()], axis=1)


def _period(told: Array) -> tuple[int, int, int] | None:
    """(first row, rows a period, whole periods) of the longest part of the motion that repeats, or None."""
    x = told - told.mean(axis=0)
    power = float(np.sum(x**2))
    n = len(x)
    if n < 4 or power / x.size < LEAST_MOTION**2:
        return None
    spectrum = np.fft.rfft(x, 2 * n, axis=0)
    r = np.fft.irfft(np.sum(np.abs(spectrum) ** 2, axis=1))[:n]
    r = r / (np.arange(n, 0, -1) / n) / r[0]
    low, high = int(SHORTEST_S / GRID_S), n // 2
    inner = np.flatnonzero(
        (r[low:high] > r[low - 1 : high - 1]) & (r[low:high] >= r[low + 1 : high + 1])
    )
    for lag in (inner + low)[np.argsort(-r[inner + low])][:20]:
        same = _same(x[:-lag], x[lag:])
        starts, ends = _longest(same)
        count = (ends - starts) // lag + 1
        if ends - starts >= lag and float(np.ptp(x[starts:ends])) > LEAST_MOTION:
            return int(starts), int(lag), int(count)
    return None


def _same(a: Array, b: Array) -> NDArray[np.bool_]:
    scale = np.maximum(a.std(axis=0), LEAST_MOTION)
    return np.asarray(np.max(np.abs(a - b) / scale, axis=1) < 2.0 * SAME)


def _longest(flags: NDArray[np.bool_]) -> tuple[int, int]:
    """Bounds of the longest unbroken run of true values."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], flags.astype(np.int8), [0]])))
    if not len(edges):
        return 0, 0
    k = int(np.argmax(edges[1::2] - edges[::2]))
    return int(edges[2 * k]), int(edges[2 * k + 1])


def _lag(a: Array, b: Array) -> int | None:
    """Rows by which `b` lags `a` where both are the same motion, or None."""
    if a.shape[1] != b.shape[1] or min(len(a), len(b)) < int(2.0 / GRID_S):
        return None
    x, y = a - a.mean(axis=0), b - b.mean(axis=0)
    if min(x.std(), y.std()) < LEAST_MOTION:
        return None
    n = len(x) + len(y)
    cross = np.fft.irfft(
        np.sum(np.conj(np.fft.rfft(x, n, axis=0)) * np.fft.rfft(y, n, axis=0), axis=1), n
    )
    lag = int(np.argmax(cross))
    lag = lag - n if lag > n // 2 else lag
    low, high = max(0, -lag), min(len(a), len(b) - lag)
    if high - low < 0.8 * min(len(a), len(b)):
        return None
    same = _same(a[low:high], b[low + lag : high + lag])
    return lag if same.mean() > 0.98 else None


def _pairs(
    problem: Problem, a: int, b: int, span: tuple[float, float], shift_s: float
) -> dict[str, tuple[Index, Index]]:
    """Nearest samples of stretch `b`, `shift_s` later, to those of stretch `a` within `span`."""
    out = {}
    for x in (s for s in problem.series if s.stretch == a):
        other = next((s for s in problem.series if s.stretch == b and s.signal == x.signal), None)
        if other is None:
            continue
        t, u = problem.t_s[x.part], problem.t_s[other.part] - shift_s
        mine = np.flatnonzero((t >= span[0]) & (t <= span[1]) & problem.kept[x.part])
        near = np.clip(np.searchsorted(u, t[mine]), 1, len(u) - 1)
        near -= (t[mine] - u[near - 1]) < (u[near] - t[mine])
        step = float(np.median(np.diff(t)))
        close = np.abs(u[near] - t[mine]) <= 0.6 * step
        close &= problem.kept[other.part][near]
        if close.sum():
            out[x.signal] = (mine[close] + x.part.start, near[close] + other.part.start)
    return out
