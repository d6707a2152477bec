"""Fits beside signals in coarser steps: those are facts, seen in the values, that each fit holds as well."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from hil.gap.fits.fitted import Calibrated, Fit
from hil.gap.record.leaf import Leaf, Start

EARNED: Final = 5.0
"""Nats that each value on a grid earns, for it cannot be there by chance."""
EFFECT: Final = "sensor_quantisation"


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


def _values_of(c: Calibrated, signal: str) -> int:
    """Values of a signal that fits see; of one that drives the twin of a ride, as many as of another."""
    counts = [(x.signal, int(c.train[x.part].sum())) for x in c.problem.series]
    own = sum(count for s, count in counts if s == signal)
    return own or max(count for _, count in counts)
