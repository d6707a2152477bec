"""A habit: what a healthy rig may have or do that its file does not say, and how much of it a record holds.

A record is asked how much of the difference that a habit makes it holds. Where that is nothing, the rig has
no such habit; where it is something, both twins are worth a look. Which there are:
`hil.gap.located.habits`.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from statistics import fmean
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel

from hil.config import RigFile
from hil.gap.located.residual import WEIGHT_ROUNDS, cost, counted
from hil.gap.located.result import Located
from hil.gap.located.sanity import Finding
from hil.gap.record.fineness import fineness
from hil.gap.record.problem import FORCES, Problem

Array = NDArray[np.float64]

FINER: Final = 0.3
"""Log of the fine structure that another twin must take off the forces of a stretch, to be theirs [of 11
records of two worlds whose drives rest it takes 0.4 to 1.9 off 10 and 0.2 off one; of 42 of ten other worlds
one holds a share of it, and has more there]."""
SOME: Final = 0.03
"""The same on average of all stretches, where nuisances are free [of 18 records of the twin whose drives do
not rest it takes 0.002 off at most, drags thirty times what calibration allows among them; of eight
shown to rest 0.6 and more where setpoints jitter, 0.07 and more where force is read in step with them]."""
LESS: Final = 6.0
"""Nats by which references must be explained better with a habit, to have it."""
HELD: Final = 0.1
"""Share of a habit, either way (when within a cycle force is sampled is not told exactly), from which on a
record may hold it [set on tuning seeds: 0.03 at most where drives do not rest and nothing is viscous]."""
TOLD: Final = 0.001
"""Of what calibration leaves, in energy, that it must explain [set on tuning seeds: legs of 2.5 kg on a
platform of 450 kg 0.0014 and 0.007, legs that weigh nothing 8e-5 at most]."""


@dataclass(frozen=True, slots=True)
class Habit:
    """One habit: what it is in a rig file, and what the reader is told of it."""

    key: str
    """In a rig file: "table.key", of every actuator where the table is theirs."""
    step: str
    """What is done once more, in words."""
    may: Callable[[RigFile], bool]
    """Whether a rig file could have it and has not."""
    twin: Callable[[RigFile, float], RigFile]
    """The rig file with it, of so large a share where it has a size."""
    text: Callable[[RigFile], str]
    """What is said of a rig whose twin is that."""
    free: tuple[str, ...] = ()
    """Endings of the nuisances that it moves of itself: they are free where a record is asked."""
    shares: tuple[float, float] = (-math.inf, math.inf)
    """Which ones can be."""
    told: float = TOLD
    """Of what calibration leaves, in energy, that it must explain."""
    asked: Callable[[Located], float] | None = None
    """What says how much of it a record seems to hold, where no linear question does."""
    sizes: tuple[float, ...] = ()
    """Shares that are tried, where what it changes does not go in proportion to its share."""
    is_unlike: bool = False
    """Whether no effect does the like: where a twin with it leaves no gap, none is weighed against it."""
    is_plain: bool = False
    """Whether hardly anything else does the like, so that a twin has it wherever that shows."""
    shows: Callable[[Located, Located], bool] | None = None
    """What then says so, of what is located with it and without; by default that it leaves less."""

    def is_shown(self, other: Located, located: Located) -> bool:
        """Whether another twin, which has it, shows that a record has it."""
        return (self.shows or leaves_less)(other, located)

    def found(self, twin: RigFile) -> Finding:
        """What the reader must know where a rig was found to have it, as `twin` has."""
        return Finding("warning", self.key, self.text(twin), belongs=self._value(twin))

    def _value(self, twin: RigFile) -> Any:
        table, key = self.key.split(".")
        owner = getattr(twin, table)
        if isinstance(owner, tuple):
            return [_plain(getattr(x, key)) for x in owner]
        return _plain(getattr(owner, key))


def _plain(value: Any) -> Any:
    return value.model_dump() if isinstance(value, BaseModel) else value


def share_of(habit: Habit, located: Located) -> float:
    """How much of what a habit would do differently what calibration left holds, beside all that the
    nuisances may do; 0 where it seems to be nothing."""
    e = located.evidence
    problem, noise = e.problem, e.noise
    if not habit.may(problem.rig):
        return 0.0
    if habit.asked is not None:
        return habit.asked(located)
    kept = problem.kept
    white = noise.whiten(problem, e.residual)[kept]
    spread = max(1.0, 1.4826 * float(np.median(np.abs(white))))
    counts = np.sqrt(counted(white / spread))
    sd = np.array([f.prior_sd for f in located.nuisances])
    nuisances = noise.whiten(problem, e.jacobian)[kept] * sd * counts[:, None]
    known = [not f.name.endswith(habit.free) for f in located.nuisances]
    prior = problem.discount * np.diag(np.asarray(known, dtype=float))
    base, rest = problem.predict(e.vector)[0], white * counts

    def changed(share: float) -> Array:
        other = Problem(
            habit.twin(problem.rig, share), problem.sent,
            clocks=problem.clocks, settle_s=problem.settle_s,
        )  # fmt: skip
        return noise.whiten(problem, other.predict(e.vector)[0] - base)[kept] * counts

    def left(columns: Array, aim: Array, held: Array) -> tuple[float, Array]:
        found = np.linalg.lstsq(columns.T @ columns + held, columns.T @ aim, rcond=None)[0]
        return float(np.sum((aim - columns @ found) ** 2)), np.asarray(found, dtype=float)

    before, _ = left(nuisances, rest, prior)
    if habit.sizes:
        tried = [(left(nuisances, rest - changed(s), prior)[0], s) for s in habit.sizes]
        least, share = min(tried)
    else:
        with_it = np.column_stack([changed(1.0), nuisances])
        least, found = left(with_it, rest, np.pad(prior, ((1, 0), (1, 0))))
        share = float(found[0])
    is_held = (abs(share) > HELD or bool(habit.sizes)) and least < (1.0 - habit.told) * before
    return share if is_held and habit.shares[0] <= share <= habit.shares[1] else 0.0


def leaves_less(other: Located, located: Located) -> bool:
    """Whether another twin leaves less of the same references by LESS nats, calibrated as it is."""
    e = located.evidence

    def left(x: Located) -> float:
        z = np.array([f.change / f.prior_sd for f in x.nuisances])
        return cost(e.noise.whiten(e.problem, x.evidence.residual), z, e.problem.discount)

    return left(other) < left(located) - LESS


def is_finer(other: Located, located: Located) -> bool:
    """Whether forces of the same record have clearly less of a structure of their own beside another twin, in
    one stretch of it and on average of all: where ticks are not found they may have more. A drag that is
    larger than calibration lets it be has such a structure as well: some must go where that is free."""
    less, freed = np.subtract(_structure(located), _structure(other))
    return bool(less.max() > FINER and less.mean() > 0.0 and freed.mean() > SOME)


def _structure(x: Located) -> Array:
    """(2, S) log of the fine structure of forces in each stretch, beside a twin as it was located and beside
    one whose nuisances are free."""
    problem = x.evidence.problem
    flat, names = problem.predict(x.evidence.vector)[0], problem.rig.actuator_names
    stretches = range(len(problem.pieces))
    return np.array(
        [
            [fmean(fineness(problem, k, a, there) for a in names) for k in stretches]
            for there in (flat, flat + _freed(x))
        ]
    )


def _freed(x: Located) -> Array:
    """(N,) by which a twin's answers would differ, as far as they go in proportion, with its nuisances where
    its forces leave least, however far that is."""
    e = x.evidence
    problem, judged = e.problem, np.zeros(e.problem.size, dtype=bool)
    for s in problem.series:
        judged[s.part] |= s.quantity in FORCES
    judged &= problem.kept
    columns = e.jacobian * np.array([f.prior_sd for f in x.nuisances])
    J, rest = columns[judged] / e.noise.sigma[judged, None], (e.residual / e.noise.sigma)[judged]
    z = np.zeros(J.shape[1])
    for _ in range(WEIGHT_ROUNDS):
        left = rest - J @ z
        spread = 1.4826 * float(np.median(np.abs(left))) + 1e-12
        D = J * counted(left / spread)[:, None]
        z = np.linalg.lstsq(D.T @ J, D.T @ rest, rcond=None)[0]
    return np.asarray(columns @ z)
