"""The parameter channel's traffic, played again: when each frame of a run got through the bus.

A record holds when setpoints were sent and when answers were received. In between frames wait for each other:
on 500 kbit/s six drives and an IMU fill most of a cycle. What waits for what is known. Control frame and
request of a slot are queued together; a drive sends its status when the control frame is there, and its
answer when the request is; of what waits at the heads of the queues the lowest identifier goes first
(ISO 11898-1), CANLust's being control, status, request, answer in this order, the IMU's below them all.
"""

from __future__ import annotations

import heapq
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hil.bus.load import bits

Array = NDArray[np.float64]
IMU: Final = 0
CONTROL: Final = 1
STATUS: Final = 2
REQUEST: Final = 3
ANSWER: Final = 4
MASTER_QUEUE: Final = 0
RIG_QUEUE: Final = 1


@dataclass(frozen=True, slots=True)
class Traffic:
    """By drive, an instant a slot (N,): when the frame had got through, s."""

    sent: tuple[Array, ...]
    controls: tuple[Array, ...]
    requests: tuple[Array, ...]
    answers: tuple[Array, ...]


def frame_s(bitrate_bps: float) -> float:
    """How long a frame of eight bytes holds the bus at worst, s."""
    return bits(8) / bitrate_bps


def played_again(
    sent: Sequence[Array],
    imu_due: Array,
    bitrate_bps: float,
    replies: Sequence[Array],
    *,
    one_queue: bool,
) -> Traffic:
    """Traffic of drives whose slots began at `sent` (each (N,), s); the IMU queues two frames at `imu_due`.

    `replies`: by drive (2, N), from the arrival of a slot's control frame and of its request to the reply's
    arrival where nothing waits, s. The master's frames leave in their order; so do those of each drive and
    of the IMU, or of all of them together (`one_queue`: one controller speaks for the whole rig, as it does
    for a simulated one or behind a bridge).
    """
    length = frame_s(bitrate_bps)
    due = [(t, IMU, frame, 0) for t in imu_due.tolist() for frame in (0, 1)]
    for i, instants in enumerate(sent):
        for k, t in enumerate(instants.tolist()):
            due += [(t, CONTROL, i, k), (t, REQUEST, i, k)]
    heapq.heapify(due)
    work = [np.maximum(r - length, 0.0).tolist() for r in replies]
    done = [[np.full(len(t), np.nan) for t in sent] for _ in range(ANSWER + 1)]
    queues: list[deque[tuple[int, int, int]]] = [deque() for _ in range(2 + len(sent))]
    free_s, waiting = -np.inf, 0
    while due or waiting:
        if not waiting:
            free_s = max(free_s, due[0][0])
        while due and due[0][0] <= free_s:
            _, kind, i, k = heapq.heappop(due)
            own = RIG_QUEUE if one_queue or kind == IMU else 2 + i
            queues[MASTER_QUEUE if kind in (CONTROL, REQUEST) else own].append((kind, i, k))
            waiting += 1
        kind, i, k = min((q for q in queues if q), key=lambda q: q[0]).popleft()
        waiting -= 1
        free_s += length
        if kind == IMU:
            continue
        done[kind][i][k] = free_s
        if kind in (CONTROL, REQUEST):
            heapq.heappush(due, (free_s + work[i][kind == REQUEST][k], kind + 1, i, k))
    return Traffic(tuple(sent), tuple(done[CONTROL]), tuple(done[REQUEST]), tuple(done[ANSWER]))
