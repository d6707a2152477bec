"""Whether the parameter of an effect is the same everywhere, as that of its law is.

What is none of the catalogue is half explained by its nearest neighbour there: drag that grows with the
square of speed by viscous friction, a motor that warms up by a force constant. The neighbour's parameter then
is another one at high speed, at the end of the record, at the end of the stroke. Each column of the fitted
parameters, times slow functions of time, place, speed, direction and load, is what such a variation would do;
what these columns take off beyond all that the fit and the nuisances could tells how much varies.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hil.gap.catalogue.bank import Bank
from hil.gap.catalogue.nature import DRAG, WAVES
from hil.gap.fits.facts import EFFECT as ROUNDED
from hil.gap.fits.fit import sensitivities
from hil.gap.fits.fitted import Calibrated, Fit, spread_of
from hil.gap.fits.frames import EFFECT as LOST
from hil.gap.fits.friction import FRICTION
from hil.gap.fits.shares import most_left
from hil.gap.fits.starts import changes_of
from hil.gap.record.leaf import Leaf
from hil.gap.record.problem import Problem, Series
from hil.gap.search.joint import LEFT
from hil.gap.search.linear import Proposal, Search

Array = NDArray[np.float64]

CUT: Final = 8.0
"""Spreads of what the fit leaves, at which whitened samples are cut."""
RIDGE: Final = 1e-6
FAINT: Final = 0.004
"""Shares that no doubt comes from, whatever else could explain them."""
OTHERS: Final = 6
"""Other candidates that are asked whether they explain the same."""
HARMONICS: Final = (2.0, 3.0)
"""Of a wave, that its law leaves open."""
CREEP: Final = 0.05
"""Of the largest speed, up to which the direction of motion is no more than begun."""


@dataclass(frozen=True, slots=True)
class Variation:
    """With what the parameters of a fit's effect vary most, and how much of the explained gap that is."""

    leaf: Leaf
    goes_with: str
    share: float


def variation(c: Calibrated, none: Fit, f: Fit, bank: Bank, worth: float) -> Variation | None:
    """The largest variation of any effect of a fit, less chance and what of it another effect of `bank` could
    take off as well; None where there is none to ask, no parameter has a column, or no actuator moves.

    Where a fit leaves nothing, only DRAG is asked.

    `worth`: by how much an estimate's variance is larger than independent noise makes it.
    """
    leaves = [x for x in f.leaves if x.effect not in (LOST, ROUNDED)]
    if most_left(c, f) < LEFT:
        leaves = [x for x in leaves if x.effect == DRAG]
    if not leaves or not c.problem.actuators:
        return None
    rows = c.train
    answer = c.problem.measured - f.residual
    columns = sensitivities(c, f.vector, answer, f.names)
    spread = np.maximum(spread_of(c, f.white), _usual(c.problem, f.white))[rows]
    cut = CUT * spread
    left = np.clip(f.white[rows], -cut, cut)
    explained = 0.5 * float(np.sum(np.clip(none.white[rows], -cut, cut) ** 2 - left**2))
    if explained <= 0.0:
        return None
    weight = 1.0 / (1.0 + (left / (2.0 * spread)) ** 2)
    fitted = np.hstack([c.jacobian[rows], columns[rows], _overtones(c, f, leaves)[rows]])
    picture = _Picture(fitted, left, weight)
    motion = c.problem.motion(f.vector)
    out: list[tuple[Variation, Array]] = []
    for leaf in leaves:
        own = columns[:, [k for k, n in enumerate(f.names) if n in leaf.parameters]]
        for goes_with, slow in _slow(c.problem, leaf, motion).items():
            varied = np.hstack([own * s[:, None] for s in slow])[rows]
            beyond = picture.gain(varied) - 0.5 * worth * varied.shape[1]
            out.append((Variation(leaf, goes_with, max(beyond, 0.0) / explained), varied))
    most, varied = max(out, key=lambda v: v[0].share)
    if most.share < FAINT:
        return most
    least = min(
        (picture.gain(np.hstack([varied, x])) - picture.gain(x) for x in _others(c, f, bank)),
        default=math.inf,
    )
    beyond = least - 0.5 * worth * varied.shape[1]
    share = min(most.share, max(beyond, 0.0) / explained)
    return replace(
        most, share=min(share, _of_energy(none.white[rows], f.white[rows], fitted, varied))
    )


def _of_energy(before: Array, after: Array, fitted: Array, varied: Array) -> float:
    """The same share of whitened squares (M,), none of them cut: a gap of hundreds of floors is cut to tens,
    and what a fit leaves of it is not: a limit that is a hundredth off would look like one that changes."""
    explained = 0.5 * float(np.sum(before**2 - after**2))
    gain = _Picture(fitted, after, np.ones(len(after))).gain(varied)
    return gain / explained if explained > 0.0 else math.inf


def _overtones(c: Calibrated, f: Fit, leaves: Sequence[Leaf]) -> Array:
    """(N, M) whitened: what the next harmonics of each wave among `leaves` would do. Of which shape a wave is
    no law says, and a shape repeats with each period."""
    shapes = list(itertools.product(HARMONICS, (0.0, 0.5 * math.pi)))
    out = []
    for leaf in leaves:
        if leaf.effect in WAVES:
            names = ("amplitude", "period", "phase")
            amplitude, period, phase = (c.problem.table.index(f"{leaf.name}.{n}") for n in names)
            rows = np.tile(f.vector, (1 + len(shapes), 1))
            rows[0, amplitude] = 0.0
            for row, (harmonic, turn) in zip(rows[1:], shapes, strict=True):
                row[period], row[phase] = row[period] / harmonic, turn
            answers = c.problem.answers(rows)
            out += [x - answers[0] for x in answers[1:] if np.all(np.isfinite(x - answers[0]))]
    return c.noise.whiten(c.problem, np.array(out).reshape(-1, c.problem.size).T)


def _usual(problem: Problem, white: Array) -> Array:
    """Of each sample (N,), what is usually left of its series, as the spread of noise that leaves as much."""
    out = np.zeros(problem.size)
    for x in problem.series:
        out[x.part] = np.median(np.abs(white[x.part])) / 0.6745
    return out


def _others(c: Calibrated, f: Fit, bank: Bank) -> list[Array]:
    """Columns on training samples of the best candidates beside a fit's own: what one of them could take off
    as well needs no parameter that varies.

    Less friction of another law where the fit has more is no other cause: the two together are a third law.
    """
    own = {x.name for x in f.leaves}
    values = dict(zip(f.names, f.values, strict=True))
    rubs = [x for x in f.leaves if x.effect in FRICTION]
    more = {x.location for x in rubs if all(values.get(n, 1.0) > 0.0 for n in x.parameters)}

    def is_other(p: Proposal) -> bool:
        leaf = bank.leaves[p.leaves[0]]
        is_third = leaf.effect in FRICTION and leaf.location in more and _is_less(c, leaf, p)
        return leaf.name not in own and not is_third

    found = Search(c, bank).beside(f).alone()
    out = []
    for p in [p for p in found if is_other(p)][:OTHERS]:
        ((start, _),) = p.starts
        columns = bank.columns[:, list(bank.places[p.leaves[0]][start])].astype(float)
        out.append(c.noise.whiten(c.problem, columns)[c.train])
    return out


def _is_less(c: Calibrated, leaf: Leaf, p: Proposal) -> bool:
    """Whether anything that a proposal of one leaf scales goes below its neutral value."""
    ((start, _),) = p.starts
    changes = changes_of([leaf], p.starts, c.problem)
    scaled = [n for n in changes if n not in leaf.starts[start].fixed]
    return any(changes[n] < c.problem.table[n].neutral for n in scaled)


class _Picture:
    """What further columns would take off a residual that some columns have been fitted to."""

    def __init__(self, fitted: Array, left: Array, weight: Array) -> None:
        self._weight, self._left = weight, left
        size = np.sqrt(np.sum(fitted**2 * weight[:, None], axis=0))
        self._fitted = fitted[:, size > 0.0] / size[size > 0.0]
        self._base = self._worth(self._fitted)

    def gain(self, columns: Array) -> float:
        """Half the weighted squares that `columns` (N, M) take off."""
        size = np.sqrt(np.sum(columns**2 * self._weight[:, None], axis=0))
        seen = columns[:, size > 0.0] / size[size > 0.0]
        return self._worth(np.hstack([self._fitted, seen])) - self._base

    def _worth(self, columns: Array) -> float:
        weighed = columns * self._weight[:, None]
        inner = columns.T @ weighed + RIDGE * np.eye(columns.shape[1])
        b = weighed.T @ self._left
        return 0.5 * float(b @ np.linalg.solve(inner, b))


def _slow(
    problem: Problem, leaf: Leaf, motion: list[dict[str, Array]]
) -> dict[str, tuple[Array, ...]]:
    """By what it goes with, functions (N,) of about 1, free of a constant as far as that is known."""
    size = {k: _size(motion, k) for a in problem.actuators for k in _keys(a)}
    out = {
        "time": [np.zeros(problem.size), np.zeros(problem.size)],
        "place": [np.zeros(problem.size) for _ in range(4)],
        "speed": [np.zeros(problem.size)],
        "direction": [np.zeros(problem.size)],
        "load": [np.zeros(problem.size), np.zeros(problem.size)],
    }
    for x in problem.series:
        moved, t = motion[x.stretch], problem.t_s[x.part]
        span = float(moved["t"][-1] - moved["t"][0])
        past = 2.0 * (t - moved["t"][0]) / span - 1.0
        out["time"][0][x.part], out["time"][1][x.part] = past, past**2
        a = _actuator(problem, leaf, x)
        if a is None:
            continue
        position, velocity, force = (
            (np.interp(t, moved["t"], moved[k]) - size[k][0]) / size[k][1] for k in _keys(a)
        )
        for row, v in zip(
            out["place"],
            (position, position**2, np.sin(1.5 * position), np.cos(3.0 * position)),
            strict=True,
        ):
            row[x.part] = v
        out["speed"][0][x.part] = np.abs(velocity)
        out["direction"][0][x.part] = np.tanh(velocity / CREEP)
        out["load"][0][x.part], out["load"][1][x.part] = np.abs(force), force
    return {k: tuple(v) for k, v in out.items()}


def _actuator(problem: Problem, leaf: Leaf, x: Series) -> str | None:
    """Whose motion a series of a leaf goes with: the leaf's own actuator, else the series' own."""
    names = problem.actuators
    for name in (leaf.location.partition(".")[0], x.actuator):
        if name in names:
            return name
    return names[0] if len(names) == 1 else None


def _keys(actuator: str) -> tuple[str, str, str]:
    return (f"{actuator}.position", f"{actuator}.velocity", f"{actuator}.force")


def _size(motion: list[dict[str, Array]], key: str) -> tuple[float, float]:
    """Middle and width of a quantity: mean and spread of a position, 0 and largest of a velocity, 0 and
    spread of a force."""
    values = np.concatenate([m[key] for m in motion])
    if key.endswith(".velocity"):
        return 0.0, max(float(np.max(np.abs(values))), 1e-12)
    middle = float(np.mean(values)) if key.endswith(".position") else 0.0
    return middle, max(float(np.std(values)), 1e-12)
