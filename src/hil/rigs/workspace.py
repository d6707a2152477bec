"""Where a rig can go: strokes that a pose would leave, ranges of coordinates, conditioning."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hil.config.rig import ROTATIONS
from hil.rigs.manipulator import Manipulator

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class StrokeViolation:
    """An actuator that a pose would take out of its travel; m or rad."""

    actuator: str
    position: float
    low: float
    high: float

    def __str__(self) -> str:
        return f"{self.actuator} at {self.position:.4f} lies outside {self.low:g}..{self.high:g}"


def stroke_violations(
    rig: Manipulator, q: ArrayLike, margin: float = 0.0
) -> tuple[StrokeViolation, ...]:
    """Actuators whose position at the pose q (n,) is not inside the stroke by `margin` (m, rad)."""
    return tuple(
        StrokeViolation(name, float(position), float(low), float(high))
        for name, position, (low, high) in zip(
            rig.actuators, rig.inverse(q), rig.strokes, strict=True
        )
        if not low + margin <= position <= high - margin
    )


def single_axis_ranges(rig: Manipulator, resolution: float = 1e-9) -> Array:
    """(n, 2): how far each coordinate goes alone, the others neutral, until a stroke ends; m, rad.

    Rotations are followed to at most half a turn, translations to the sum of all strokes.
    """
    ranges = np.zeros((rig.n, 2))
    travel = float(np.sum(rig.strokes[:, 1] - rig.strokes[:, 0]))
    for axis, coordinate in enumerate(rig.coordinates):
        end = np.pi if coordinate in ROTATIONS else travel
        for side, sign in enumerate((-1.0, 1.0)):
            ranges[axis, side] = sign * _reach(rig, sign * np.eye(rig.n)[axis], end, resolution)
    return ranges


def _reach(rig: Manipulator, direction: Array, end: float, resolution: float) -> float:
    """Largest distance along `direction` with all strokes kept: coarse steps, then bisection."""
    inside, step = 0.0, end / 200.0
    while inside + step <= end and not stroke_violations(rig, (inside + step) * direction):
        inside += step
    while step > resolution:
        step /= 2.0
        if inside + step <= end and not stroke_violations(rig, (inside + step) * direction):
            inside += step
    return inside


@dataclass(frozen=True, slots=True)
class ConditionMap:
    """Conditioning of the Jacobian over a grid of poses."""

    poses: Array
    """(k, n): the grid, m and rad."""
    condition: Array
    """(k,): condition number of J with rotations measured in m at the characteristic length."""
    determinant: Array
    """(k,): determinant of J; a sign that changes means a singular pose between."""


def condition_map(
    rig: Manipulator, points: int = 7, characteristic_length_m: float = 1.0
) -> ConditionMap:
    """Conditioning on a grid of `points` per coordinate over ± the rig file's limits.

    For the motorcycle platform J is J_-1 A, the 3x3 matrix that must be invertible ("Parameters
    Identification for Motorcycle Simulator's Platform Characterization", after (13), mended: the
    printed statement is about the 3x6 J_-1).
    """
    axes = [np.linspace(-limit, limit, points) for limit in rig.limits]
    poses = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, rig.n)
    jacobians = np.array([rig.jacobian(q) for q in poses])
    lengths = np.array(
        [characteristic_length_m if c in ROTATIONS else 1.0 for c in rig.coordinates]
    )
    return ConditionMap(poses, np.linalg.cond(jacobians / lengths), np.linalg.det(jacobians))
