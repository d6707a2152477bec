"""Compiled: poses at given instants as a motion with continuous velocity and acceleration.

At each pose velocity and acceleration are those of the polynomial through it and up to two neighbours
on either side (finite differences on any grid: Fornberg, "Generation of Finite Difference Formulas on
Arbitrarily Spaced Grids", Math. Comp. 51, 1988 [M]); quintics join the poses. So a motion that is known
two poses ahead no longer changes when more of it becomes known.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hil.compiled import compiled

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]

REACH = 2
"""Neighbours on either side that tell a pose's velocity and acceleration."""
ORDERS = 3
"""Derivatives 0, 1, 2."""


@compiled
def difference_weights(nodes: Vector, at: float, weights: Matrix) -> None:
    """Weights (len(nodes), 3) of values at `nodes` for value, first and second derivative at `at`."""
    weights[:, :] = 0.0
    weights[0, 0] = 1.0
    c1, c4 = 1.0, nodes[0] - at
    for i in range(1, nodes.shape[0]):
        most = min(i, ORDERS - 1)
        c2, c5, c4 = 1.0, c4, nodes[i] - at
        for j in range(i):
            c3 = nodes[i] - nodes[j]
            c2 *= c3
            if j == i - 1:
                for k in range(most, 0, -1):
                    weights[i, k] = c1 * (k * weights[j, k - 1] - c5 * weights[j, k]) / c2
                weights[i, 0] = -c1 * c5 * weights[j, 0] / c2
            for k in range(most, 0, -1):
                weights[j, k] = (c4 * weights[j, k] - k * weights[j, k - 1]) / c3
            weights[j, 0] = c4 * weights[j, 0] / c3
        c1 = c2


@compiled
def is_jump(times: Vector, poses: Matrix, v_max: Vector, i: int, k: int) -> bool:
    """Whether only a jump joins poses i and i + 1 of coordinate k: faster than v_max."""
    jump: bool = abs(poses[i + 1, k] - poses[i, k]) > v_max[k] * (times[i + 1] - times[i])
    return jump


@compiled
def derivatives(times: Vector, poses: Matrix, v_max: Vector, v: Matrix, a: Matrix) -> None:
    """Velocity and acceleration (m, n) at poses (m, n) at increasing times (m,).

    Neighbours beyond a jump lend nothing, so that a step is a step between resting poses and no kick.
    """
    count, n = poses.shape
    weights = np.zeros((2 * REACH + 1, ORDERS))
    for i in range(count):
        first, last = -1, -1
        for k in range(n):
            low, high = i, i
            while low > max(i - REACH, 0) and not is_jump(times, poses, v_max, low - 1, k):
                low -= 1
            while high < min(i + REACH, count - 1) and not is_jump(times, poses, v_max, high, k):
                high += 1
            if low != first or high != last:
                difference_weights(times[low : high + 1], times[i], weights)
                first, last = low, high
            speed, acceleration = 0.0, 0.0
            for j in range(low, high + 1):
                # Differences to the pose itself: constant poses have no speed, to the last bit.
                away = poses[j, k] - poses[i, k]
                speed += weights[j - low, 1] * away
                acceleration += weights[j - low, 2] * away
            v[i, k] = speed
            a[i, k] = acceleration


@compiled
def evaluate(
    times: Vector, poses: Matrix, v: Matrix, a: Matrix, v_max: Vector, at: float, out: Matrix
) -> None:
    """Position, velocity, acceleration at `at` into out (3, n); between the first and the last pose.

    Across a jump the pose runs from one to the other without velocity.
    """
    i = min(max(np.searchsorted(times, at, "right"), 1), times.shape[0] - 1) - 1
    h = times[i + 1] - times[i]
    u = (at - times[i]) / h
    for k in range(poses.shape[1]):
        rise = poses[i + 1, k] - poses[i, k]
        if is_jump(times, poses, v_max, i, k):
            out[0, k] = poses[i, k] + u * rise
            out[1, k] = 0.0
            out[2, k] = 0.0
            continue
        c1, c2 = v[i, k] * h, 0.5 * a[i, k] * h * h
        d = rise - c1 - c2
        dv = v[i + 1, k] * h - c1 - 2.0 * c2
        da = a[i + 1, k] * h * h - 2.0 * c2
        c3 = 10.0 * d - 4.0 * dv + 0.5 * da
        c4 = -15.0 * d + 7.0 * dv - da
        c5 = 6.0 * d - 3.0 * dv + 0.5 * da
        out[0, k] = poses[i, k] + u * (c1 + u * (c2 + u * (c3 + u * (c4 + u * c5))))
        out[1, k] = (c1 + u * (2.0 * c2 + u * (3.0 * c3 + u * (4.0 * c4 + u * 5.0 * c5)))) / h
        out[2, k] = (2.0 * c2 + u * (6.0 * c3 + u * (12.0 * c4 + u * 20.0 * c5))) / (h * h)
