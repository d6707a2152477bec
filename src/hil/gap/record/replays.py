"""Replays on all cores, and none made twice: of a record that many look at one after another, one replay in
ten is asked again soon."""

from __future__ import annotations

import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hil.sim.twin import Replay

Array = NDArray[np.float64]

RECENT: Final = 128
"""Replays that are kept."""


def run_all(tasks: Sequence[tuple[Replay, Array]], *, once: bool = False) -> list[Array]:
    """Every replay with its parameter vector, on all cores; `once`: nobody asks the same again, or it is too
    large to be kept."""

    def run(task: tuple[Replay, Array]) -> Array:
        job, row = task
        return job.run(row) if once else _remembered(job, np.asarray(row, dtype=float).tobytes())

    if len(tasks) == 1:
        return [run(tasks[0])]
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        return list(pool.map(run, tasks))


@lru_cache(maxsize=RECENT)
def _remembered(job: Replay, row: bytes) -> Array:
    out = job.run(np.frombuffer(row))
    out.flags.writeable = False
    return out
