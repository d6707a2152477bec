"""The bicycle near steady straight running: canonical matrices, state matrix, eigenvalues over speed.

Derivatives of the nonlinear model by complex steps, exact to rounding: no second model to keep in step.
Canonical form M q'' + v C1 q' + (g K0 + v² K2) q = f with q = (lean, steer), lean to the right and steer
to the RIGHT positive, as in "Linearized dynamics equations for the balance and steer of a bicycle: a
benchmark and review" (Meijaard, Papadopoulos, Ruina and Schwab 2007); its tables are met [V].
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hil.rigs.bicycle.kernel import (
    assemble,
    constraint_rows,
    evaluate,
    factor,
    memory,
    reduce,
    solve,
)
from hil.rigs.bicycle.parameters import Packed

Array = NDArray[np.float64]

STEP: Final = 1e-30
"""Complex step: no difference is formed, so it may be as small as floats go."""
_ROWS: Final = np.array([6, 7, 8])
_SIGNS: Final = np.array([1.0, -1.0])
"""Steer to the right positive, where the model counts to the left."""


@dataclass(frozen=True, slots=True)
class Canonical:
    """Canonical matrices (2, 2) by lean and steer; kg m2, kg m, kg; g in m/s2."""

    M: Array
    C1: Array
    K0: Array
    K2: Array
    g: float

    def state_matrix(self, speed: float) -> Array:
        """A (4, 4) of the state (lean, steer, lean rate, steer rate) at a forward speed in m/s."""
        low = np.linalg.solve(
            self.M, -np.hstack([self.g * self.K0 + speed**2 * self.K2, speed * self.C1])
        )
        return np.vstack([np.hstack([np.zeros((2, 2)), np.eye(2)]), low])

    def input_matrix(self) -> Array:
        """B (4, 2): lean torque and steer torque, N m, at that state."""
        return np.vstack([np.zeros((2, 2)), np.linalg.inv(self.M)])

    def eigenvalues(self, speeds: ArrayLike) -> NDArray[np.complex128]:
        """(S, 4) by speed, 1/s; each row sorted by real part, then imaginary."""
        rows = [
            np.sort_complex(np.linalg.eigvals(self.state_matrix(v))) for v in np.atleast_1d(speeds)
        ]
        return np.array(rows)

    def stable_range(self, top: float = 15.0) -> tuple[float, float] | None:
        """Weave and capsize speed, m/s: self-stable in between; None where it never is below `top`."""
        grid = np.linspace(0.05, top, 600)
        worst = self.eigenvalues(grid).real.max(axis=1)
        stable = np.flatnonzero(worst < 0.0)
        if not stable.size:
            return None
        first, last = int(stable[0]), int(stable[-1])

        def edge(a: float, b: float) -> float:
            sign = self.eigenvalues(a)[0].real.max() < 0.0
            for _ in range(60):
                middle = 0.5 * (a + b)
                if (self.eigenvalues(middle)[0].real.max() < 0.0) == sign:
                    a = middle
                else:
                    b = middle
            return 0.5 * (a + b)

        low = edge(grid[first - 1], grid[first]) if first else 0.0
        high = edge(grid[last], grid[last + 1]) if last + 1 < len(grid) else top
        return low, high


def linearise(bicycle: Packed, speed: float) -> tuple[Array, Array]:
    """A (4, 4), B (4, 2) of the NONLINEAR model at steady straight running at `speed`, m/s.

    State (lean right, steer right, rates), inputs lean and steer torque; without aerodynamic drag, which
    no steady speed withstands without drive.
    """
    free = replace(bicycle, extra=_without_drag(bicycle.extra))
    A = np.zeros((4, 4))
    A[0, 2] = A[1, 3] = 1.0
    for k in range(4):
        state = np.zeros(4, complex)
        state[k] = STEP * 1j
        acceleration, _ = _respond(free, speed, state)
        A[2:, k] = acceleration.imag / STEP
    _, Mr = _respond(free, speed, np.zeros(4, complex))
    B = np.zeros((4, 2))
    B[2:] = np.linalg.inv(Mr.real)
    return A, B


def canonical(bicycle: Packed) -> Canonical:
    """The canonical matrices, from the nonlinear model."""
    g = float(bicycle.extra[0])
    _, Mr = _respond(bicycle, 0.0, np.zeros(4, complex))
    M = Mr.real
    at_rest, at_one = linearise(bicycle, 0.0)[0], linearise(bicycle, 1.0)[0]
    K0 = -M @ at_rest[2:, :2] / g
    K2 = -M @ at_one[2:, :2] - g * K0
    C1 = -M @ at_one[2:, 2:]
    return Canonical(M, C1, K0, K2, g)


def _respond(
    bicycle: Packed, speed: float, state: NDArray[np.complex128]
) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
    """Accelerations (2,) and reduced mass (2, 2) of lean and steer, for complex lean, steer and rates.

    Pitch and contact angle stay zero: the bicycle is symmetric, so that they are of second order.
    """
    like = np.zeros(1, complex)
    q, qd = np.zeros(12, complex), np.zeros(12, complex)
    q[3], q[6] = state[0], -state[1]
    mem = memory(like)
    D, M, Q = np.zeros((12, 12), complex), np.zeros((9, 9), complex), np.zeros(9, complex)
    order = np.zeros(9, np.int64)
    constraint_rows(bicycle.p, q, 9, False, D)
    factor(D, 9, order)
    qd[6:9] = state[2], speed / bicycle.p[0], -state[3]
    solve(D, 9, order, qd)
    evaluate(mem, bicycle.p, q, qd)
    assemble(mem, bicycle.body, bicycle.extra, qd, 9, M, Q)
    N, Mr, Qr = np.zeros((9, 3), complex), np.zeros((3, 3), complex), np.zeros(3, complex)
    reduce(mem, D, order, M, Q, 9, _ROWS, N, Mr, Qr, np.zeros(9, complex))
    told = np.linalg.solve(Mr, Qr)
    lateral = np.ix_([0, 2], [0, 2])
    return told[[0, 2]] * _SIGNS, np.outer(_SIGNS, _SIGNS) * Mr[lateral]


def _without_drag(extra: Array) -> Array:
    out = extra.copy()
    out[1] = 0.0
    return out
