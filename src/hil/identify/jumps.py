"""Where a rig's jumps of force fall: times are moved in turn until the twin's fall on them and least is left.

In a stiff drive force jumps at each new setpoint, and a setpoint that acts a tick late leaves a jump many
times the noise. No slope leads there, so places are tried, coarse ones first.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Hashable, Iterable, Mapping
from concurrent.futures import ThreadPoolExecutor
from typing import Final, TypeVar

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
K = TypeVar("K", bound=Hashable)
V = TypeVar("V")

JUMP: Final = 1.5
"""Typical steps of force from which on one counts by its logarithm."""


def fewest_jumps(
    start: Mapping[K, V],
    turns: Iterable[tuple[int, Callable[[K, V, int], V]]],
    steps: Callable[[Mapping[K, V]], Mapping[K, Array]],
) -> tuple[dict[K, V], dict[K, float]]:
    """Of each key the value that leaves the fewest jumps, and how much less that is than `start` leaves.

    `steps`: sizes (M,) of the steps of force that each key's value leaves, all computed at once, and those of
    different values on all cores. A turn is how many places are tried either way, and the place so many from
    a value, for each key about the best before.
    """
    first = steps(start)
    usual = {key: JUMP * float(np.median(s)) + 1e-12 for key, s in first.items()}
    least = {key: _size(s, usual[key]) for key, s in first.items()}
    before, best = dict(least), dict(start)
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        for most, moved in turns:
            counts = sorted(range(-most, most + 1), key=abs)[1:]
            tries = [{key: moved(key, v, count) for key, v in best.items()} for count in counts]
            for tried, sizes in zip(tries, pool.map(steps, tries), strict=True):
                for key, s in sizes.items():
                    size = _size(s, usual[key])
                    if size < least[key]:
                        least[key], best[key] = size, tried[key]
    return best, {key: before[key] - size for key, size in least.items()}


def _size(steps: Array, usual: float) -> float:
    """Of the jumps among `steps` of a force, large ones by their logarithm."""
    return float(np.mean(np.log1p((steps / usual) ** 2)))
