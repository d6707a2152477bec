"""Which candidates, alone or together, could explain a residual: a search in the linear picture.

All columns are whitened, freed of what the nuisances explain, and reduced to their inner products, so that
thousands of sets cost no more than their small matrices. It only proposes: what it ranks is fitted through
the twin afterwards.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import lsq_linear

from hil.gap.catalogue.bank import Bank
from hil.gap.catalogue.nature import LIMITS, NEAR, ONE_SIDED
from hil.gap.catalogue.nuisances import LIMIT
from hil.gap.fits.fitted import Calibrated, Fit, loss, weight

Array = NDArray[np.float64]

CUT: Final = 100.0
"""Whitened residuals are cut there: a few wild samples must not choose."""
RIDGE: Final = 1e-6
FEW: Final = 2
MANY: Final = 40
"""Starts of a leaf that are judged robustly: the best by squares, or nearly all."""
LOOKED_AT: Final = 24
"""Leaves beside others that are judged robustly: those that take most by squares."""
NEAR_RANGE: Final = (0.8, 1.25)
"""Amplitudes of effects whose columns are what they do only near a start."""
ROBUST: Final = 4
"""Reweighted steps that make amplitudes robust."""
FELT: Final = 1.0
"""Squared whitened size that a usual step of a parameter, or the proposed one, must have to be fitted."""


@dataclass(frozen=True, slots=True)
class Proposal:
    """A set of leaves with starts and amplitudes, and what it would take off half the sum of squares."""

    leaves: tuple[int, ...]
    starts: tuple[tuple[int, Array], ...]
    gain: float
    z: Array
    """(K,) nuisances that go with it."""


def _best_first(found: Iterable[Proposal | None]) -> list[Proposal]:
    return sorted((p for p in found if p is not None), key=lambda p: -p.gain)


_Found = tuple[Proposal, Array, Array]
"""A proposal, how far the nuisances (K,) go without it, and what each of its columns takes of that (K, P)."""


class Search:
    """The bank of a calibrated problem as inner products."""

    def __init__(self, c: Calibrated, bank: Bank) -> None:
        self.bank = bank
        rows = c.train
        self._A = c.jacobian[rows]
        self._AT = np.ascontiguousarray(self._A.T)
        # One column after the other in memory: sets of few columns are what is asked for.
        T = np.empty((int(rows.sum()), bank.columns.shape[1]), dtype=np.float32, order="F")
        for first in range(0, T.shape[1], 32):
            part = bank.columns[:, first : first + 32].astype(float)
            T[:, first : first + 32] = c.noise.whiten(c.problem, part)[rows]
        self._T = T
        wild = c.noise.spikes(c.problem, c.residual)[rows]
        self._calm = np.where(wild[:, None], 0.0, self._A)
        self._raw = (T.T @ T - T[wild].T @ T[wild]).astype(float)
        self.raw: Array = np.diag(self._raw)
        """(M,) squared whitened size of each column before the nuisances took their part."""
        self._cross = (self._calm.T.astype(np.float32) @ T).astype(float)
        self._held = c.problem.discount
        self._rows, self._wild = rows, wild
        self._look(c.white, c.z)

    def beside(self, f: Fit) -> Search:
        """The same columns beside what a fit leaves."""
        out = copy(self)
        out._look(f.white, f.z)
        return out

    def _look(self, white: Array, z: Array) -> None:
        """Take a whitened residual (N,), left with the nuisances `z` (K,), for what is to be explained."""
        self._white, self._z = white[self._rows], z
        self._spread = max(1.0, 1.4826 * float(np.median(np.abs(self._white))))
        self._before = float(np.sum(loss(self._white / self._spread)))
        r = np.clip(self._white, -CUT, CUT)
        r[self._wild] = 0.0
        A, cross, raw = self._calm, self._cross, self._raw
        inner = (self._T.T @ r.astype(np.float32)).astype(float)
        self._inner, self._own = inner, (A.T @ A, A.T @ r)
        free = np.abs(z) < LIMIT - 1e-3
        # Nuisances at their bounds would go on outwards, or come back once an effect is there: both are seen.
        self._pictures: list[tuple[Array, Array, Array]] = []
        for some in (free, np.ones_like(free)) if not free.all() else (free,):
            part = A[:, some]
            H = part.T @ part + self._held * np.eye(part.shape[1])
            AT = cross[some]
            S = np.linalg.solve(H, np.column_stack([AT, part.T @ r - self._held * z[some]]))
            moves = np.zeros((len(free), S.shape[1]))
            moves[some] = S
            self._pictures.append((raw - AT.T @ S[:, :-1], inner - AT.T @ S[:, -1], moves))

    def felt(self, start: Mapping[str, float], p: Proposal) -> dict[str, float]:
        """`start`, that of `p`, without parameters whose own columns change nothing that these data would
        show: neither by a usual step nor by the one that is proposed."""
        dull: set[str] = set()
        seen: set[str] = set()
        steps = {
            k: float(a)
            for leaf, (s, amplitudes) in zip(p.leaves, p.starts, strict=True)
            for k, a in zip(self.bank.places[leaf][s], amplitudes, strict=True)
        }
        for leaf, places in zip(self.bank.leaves, self.bank.places, strict=True):
            for s, columns in zip(leaf.starts, places, strict=True):
                for moved, k in zip(s.columns, columns, strict=True):
                    size = self.raw[k] * max(steps.get(k, 1.0) ** 2, 1.0)
                    (dull if size < FELT else seen).update(moved)
        return {n: v for n, v in start.items() if n not in dull - seen}

    def alone(self) -> list[Proposal]:
        """Every leaf with its best start, best first."""
        return _best_first(self.set_of((k,)) for k in range(len(self.bank.leaves)))

    def pairs(self, alone: Sequence[Proposal]) -> list[Proposal]:
        """Every two of the single proposals `alone`, each with its own start, best first."""
        out = []
        for a, b in itertools.combinations(alone, 2):
            only = ((a.starts[0][0],), (b.starts[0][0],))
            out.append(self.set_of((a.leaves[0], b.leaves[0]), only))
        return _best_first(out)

    def with_one_more(self, p: Proposal, further: Iterable[int]) -> list[Proposal]:
        """`p`, its starts as they are, with each of the leaves `further` beside it, best first: of those
        that take most by squares, LOOKED_AT and all limits, whose squares say little."""
        kept = [(s,) for s, _ in p.starts]
        found = [
            (
                (*p.leaves, k),
                self._by_squares((*p.leaves, k), (*kept, range(len(self.bank.places[k])))),
            )
            for k in further
        ]
        found.sort(key=lambda x: -x[1][0][0].gain if x[1] else np.inf)
        limits = [x for x in found[LOOKED_AT:] if self.bank.leaves[x[0][-1]].effect in LIMITS]
        return _best_first(self._best_of(*x) for x in (*found[:LOOKED_AT], *limits))

    def set_of(
        self, leaves: tuple[int, ...], only: Sequence[Sequence[int]] | None = None
    ) -> Proposal | None:
        """The best starts (`only`: among these of each leaf) and amplitudes of a set of leaves.

        Amplitudes are those of least squares, made robust for the best; what a start is worth is judged
        robustly, for an impact that comes a little early is worse than none in squares and still the right
        idea.
        """
        options = only or [range(len(self.bank.places[k])) for k in leaves]
        return self._best_of(leaves, self._by_squares(leaves, options))

    def _by_squares(
        self, leaves: tuple[int, ...], options: Sequence[Sequence[int]]
    ) -> list[_Found]:
        """A set of leaves with each of the starts `options`, best first by squares."""
        found: list[_Found] = []
        for starts in itertools.product(*options):
            columns = [self.bank.places[k][s] for k, s in zip(leaves, starts, strict=True)]
            index = [i for c in columns for i in c]
            for gram, inner, moves in self._pictures:
                G = gram[np.ix_(index, index)]
                size = np.sqrt(np.maximum(np.diag(G), 1e-12))
                scaled = G / np.outer(size, size) + RIDGE * np.eye(len(index))
                best, gain = self._bounded(leaves, columns, scaled, inner[index] / size, size)
                ends = np.cumsum([len(c) for c in columns])[:-1]
                for a in (best, np.ones(1)) if self._is_finite(leaves) else (best,):
                    parts = tuple(zip(starts, np.split(a, ends), strict=True))
                    found.append(self._found(Proposal(leaves, parts, gain, self._z), moves, index))
        return sorted(found, key=lambda x: -x[0].gain)

    def _best_of(self, leaves: tuple[int, ...], found: Sequence[_Found]) -> Proposal | None:
        """The most robust of what was `found` of a set of leaves, best first by squares."""
        few = found[: MANY if self._is_finite(leaves) else FEW]
        gains = self._worth([p for p, *_ in few])
        real = [
            (replace(p, gain=g), shift, drag)
            for g, (p, shift, drag) in zip(gains, few, strict=True)
        ]
        if not real:
            return None
        real.sort(key=lambda x: -x[0].gain)
        real += [self._within(p) for p, *_ in real[:FEW] if np.any(np.abs(p.z) >= LIMIT)]
        chosen = max(real, key=lambda x: x[0].gain)
        return chosen[0] if self._is_finite(leaves) else self._robust(*chosen)

    def _found(self, p: Proposal, moves: Array, index: Sequence[int]) -> _Found:
        """`p` with the nuisances that go with it, cut at their bounds."""
        shift, drag = moves[:, -1], moves[:, index]
        a = np.concatenate([a for _, a in p.starts])
        return replace(p, z=np.clip(self._z + shift - drag @ a, -LIMIT, LIMIT)), shift, drag

    def _within(self, p: Proposal) -> _Found:
        """`p` anew with nuisances that keep their bounds, which amplitudes then know of."""
        index = self._index(p)
        AA, Ar = self._own
        n = len(AA)
        H = np.block(
            [[AA + self._held * np.eye(n), self._cross[:, index]],
             [self._cross[:, index].T, self._raw[np.ix_(index, index)]]]
        )  # fmt: skip
        g = np.concatenate([Ar - self._held * self._z, self._inner[index]])
        size = np.sqrt(np.maximum(np.diag(H), 1e-12))
        lower, upper = self._bounds(p.leaves, [len(a) for _, a in p.starts])
        low = np.concatenate([-LIMIT - self._z, lower]) * size
        high = np.concatenate([LIMIT - self._z, upper]) * size
        root = _root(H / np.outer(size, size) + RIDGE * np.eye(len(H)))
        aim = np.linalg.solve(root, g / size)
        x = lsq_linear(root.T, aim, (low, high), method="bvls").x / size
        ends = np.cumsum([len(a) for _, a in p.starts])[:-1]
        parts = zip([s for s, _ in p.starts], np.split(x[n:], ends), strict=True)
        new = replace(p, starts=tuple(parts), z=self._z + x[:n])
        return self._judged(new), x[:n], np.zeros((n, len(index)))

    def _index(self, p: Proposal) -> list[int]:
        """Columns of a proposal."""
        return [
            i for k, (s, _) in zip(p.leaves, p.starts, strict=True) for i in self.bank.places[k][s]
        ]

    def _robust(self, p: Proposal, shift: Array, drag: Array) -> Proposal:
        """`p` with the amplitudes that the robust loss wants, nuisances along with them, if that is better:
        a few wild samples make those of squares far too small."""
        index = self._index(p)
        T = self._T[:, index].astype(float) - self._A @ drag
        rest = self._white - self._A @ shift
        lower, upper = self._bounds(p.leaves, [len(a) for _, a in p.starts])
        a = np.concatenate([a for _, a in p.starts])
        for _ in range(ROBUST):
            left = (rest - T @ a) / self._spread
            D = T * weight(left)[:, None]
            ridge = RIDGE * np.diag(self.raw[index] + 1e-12)
            a = np.clip(np.linalg.solve(D.T @ T + ridge, D.T @ rest), lower, upper)
        z = np.clip(self._z + shift - drag @ a, -LIMIT, LIMIT)
        ends = np.cumsum([len(x) for _, x in p.starts])[:-1]
        starts = tuple((s, x) for (s, _), x in zip(p.starts, np.split(a, ends), strict=True))
        return max(p, self._judged(Proposal(p.leaves, starts, 0.0, z)), key=lambda x: x.gain)

    def _is_finite(self, leaves: tuple[int, ...]) -> bool:
        """Whether a leaf alone is one that squares misjudge: its starts themselves are worth a look."""
        return len(leaves) == 1 and self.bank.leaves[leaves[0]].effect in NEAR | LIMITS

    def _judged(self, p: Proposal) -> Proposal:
        return replace(p, gain=self._worth([p])[0])

    def _worth(self, proposals: Sequence[Proposal]) -> list[float]:
        """Robust gain (nats of the loss that fits use) of each proposal, nuisances along with it."""
        if not proposals:
            return []
        moves = np.array([p.z - self._z for p in proposals]) @ self._AT
        gains = []
        for change, p in zip(moves, proposals, strict=True):
            a = np.concatenate([a for _, a in p.starts])
            left = self._white - change - self._T[:, self._index(p)].astype(float) @ a
            after = float(np.sum(loss(left / self._spread)))
            held = 0.5 * self._held * float(self._z @ self._z - p.z @ p.z)
            gains.append(self._spread**2 * (self._before - after) + held)
        return gains

    def _bounds(self, leaves: Sequence[int], counts: Sequence[int]) -> tuple[Array, Array]:
        """What each effect allows of the amplitudes of its `counts` columns."""
        lower, upper = np.full(sum(counts), -np.inf), np.full(sum(counts), np.inf)
        k = 0
        for leaf, count in zip(leaves, counts, strict=True):
            effect = self.bank.leaves[leaf].effect
            part = slice(k, k + count)
            if effect in LIMITS:
                lower[part], upper[part] = 0.999, 1.001
            elif effect in NEAR:
                lower[part], upper[part] = NEAR_RANGE
            elif effect in ONE_SIDED:
                lower[part] = 0.0
            k += count
        return lower, upper

    def _bounded(
        self,
        leaves: Sequence[int],
        columns: Sequence[Sequence[int]],
        scaled: Array,
        b: Array,
        size: Array,
    ) -> tuple[Array, float]:
        """Amplitudes within what each effect allows, and the gain they have."""
        lower, upper = self._bounds(leaves, [len(cols) for cols in columns])
        a = np.linalg.solve(scaled, b) / size
        if np.any(a < lower) or np.any(a > upper):
            root = _root(scaled)
            aim = np.linalg.solve(root, b)
            a = lsq_linear(root.T, aim, (lower * size, upper * size), method="bvls").x / size
        s = a * size
        return a, float(b @ s - 0.5 * s @ scaled @ s)


def _root(scaled: Array) -> Array:
    """Lower factor of inner products; rounding may have made those of nearly equal columns indefinite."""
    try:
        return np.asarray(np.linalg.cholesky(scaled))
    except np.linalg.LinAlgError:
        size, turn = np.linalg.eigh(scaled)
        return np.asarray(np.linalg.cholesky(turn * np.maximum(size, np.sqrt(RIDGE)) @ turn.T))
