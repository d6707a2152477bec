"""Fits beside facts, seen in values and rows, that each fit holds as well: signals in coarser steps, answers
that never came."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from hil.gap.fits.fitted import Calibrated, Fit
from hil.gap.fits.frames import ANSWERS
from hil.gap.fits.frames import EFFECT as LOST
from hil.gap.record.leaf import Leaf, Start
from hil.gap.record.missing import Missing

EARNED: Final = 5.0
"""Nats that each value on a grid earns, and each answer that is missing: none is by chance."""
EFFECT: Final = "sensor_quantisation"


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
