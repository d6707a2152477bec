"""One bicycle's equations of motion: accelerations under torques, energy, states on the constraints."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hil.config.bicycle import BicycleFile
from hil.errors import KinematicsError
from hil.rigs.bicycle.kernel import (
    assemble,
    close_loop,
    constraint_rows,
    evaluate,
    factor,
    memory,
    reduce,
    solve,
    solve_transposed,
)
from hil.rigs.bicycle.parameters import Packed, pack

Array = NDArray[np.float64]

COORDINATES: Final = ("x", "y", "phi", "theta", "psi", "beta", "gamma", "eps", "xi")
"""Rear contact (m), yaw, lean (right), rear wheel, frame pitch, steer (left), front wheel, contact angle."""
_ROWS: Final = np.array([6, 7, 8])


@dataclass(frozen=True, slots=True)
class Response:
    """Accelerations qdd (9,) and multipliers (9,) of D's rows; the last three are zero in free motion."""

    qdd: Array
    multipliers: Array


class Whipple:
    """The nonlinear Whipple model in nine coordinates with six constraints."""

    def __init__(self, bicycle: BicycleFile | Packed) -> None:
        self.packed = pack(bicycle) if isinstance(bicycle, BicycleFile) else bicycle

    def closed(self, q: ArrayLike) -> Array:
        """q (9,) with frame pitch and contact angle set so that the front wheel touches the road.

        KinematicsError where none do.
        """
        full = _wide(q)
        residual, steps = close_loop(
            self.packed.p, full, np.zeros(2), np.zeros((2, 2)), np.zeros(3)
        )
        if not residual < 1e-10:
            raise KinematicsError(
                f"the front wheel does not reach the road at lean {full[3]:.3f}, steer {full[6]:.3f} rad: "
                f"{residual:.3g} m remain after {steps} steps"
            )
        return full[:9]

    def rates(self, q: ArrayLike, lean: float, wheel: float, steer: float) -> Array:
        """qd (9,) that keeps the constraints, from the rates of lean, rear wheel (psi) and steer, rad/s."""
        full = _wide(q)
        D, order = np.zeros((12, 12)), np.zeros(9, np.int64)
        constraint_rows(self.packed.p, full, 9, False, D)
        self._factor(D, order, full)
        b = np.zeros(9)
        b[6:] = lean, wheel, steer
        solve(D, 9, order, b)
        return b

    def respond(
        self, q: ArrayLike, qd: ArrayLike, lean: float = 0.0, drive: float = 0.0, steer: float = 0.0
    ) -> Response:
        """Accelerations and constraint multipliers under torques, N m.

        `lean` acts on the frame from outside, `drive` between frame and rear wheel, `steer` between frame
        and fork (left positive).
        """
        full, rates = _wide(q), _wide(qd)
        mem = memory(full)
        evaluate(mem, self.packed.p, full, rates)
        M, Q, D = np.zeros((9, 9)), np.zeros(9), np.zeros((12, 12))
        order = np.zeros(9, np.int64)
        assemble(mem, self.packed.body, self.packed.extra, rates, 9, M, Q)
        Q[3] += lean
        Q[4] += drive
        Q[5] -= drive
        Q[6] += steer
        constraint_rows(self.packed.p, full, 9, False, D)
        self._factor(D, order, full)
        N, Mr, Qr, bias = np.zeros((9, 3)), np.zeros((3, 3)), np.zeros(3), np.zeros(9)
        reduce(mem, D, order, M, Q, 9, _ROWS, N, Mr, Qr, bias)
        qdd = bias + N @ np.linalg.solve(Mr, Qr)
        multipliers = Q - M @ qdd
        solve_transposed(D, 9, order, multipliers)
        return Response(qdd, multipliers)

    def violation(self, q: ArrayLike, qd: ArrayLike) -> Array:
        """J qd (6,): how far rates are from the constraints, m/s."""
        full, rates = _wide(q), _wide(qd)
        D = np.zeros((12, 12))
        constraint_rows(self.packed.p, full, 9, False, D)
        out: Array = D[:6] @ rates
        return out

    def energy(self, q: ArrayLike, qd: ArrayLike) -> float:
        """Kinetic energy and height's, J, the latter counted from the road."""
        full, rates = _wide(q), _wide(qd)
        mem = memory(full)
        evaluate(mem, self.packed.p, full, rates)
        M, Q = np.zeros((9, 9)), np.zeros(9)
        assemble(mem, self.packed.body, self.packed.extra, rates, 9, M, Q)
        heights = self.heights(q)
        weight = self.packed.body[:, 0] * self.packed.extra[0]
        return float(0.5 * rates[:9] @ M @ rates[:9] + weight @ heights)

    def heights(self, q: ArrayLike) -> Array:
        """Heights (4,) of the bodies' centres of gravity above the road, m."""
        full = _wide(q)
        (r_r, _, _, sl, cl, xa, za, x3, z3, x4, z4, x5, z5) = self.packed.p
        lean, pitch, steer = full[3], full[5], full[6]
        ct, cb, sb = np.cos(lean), np.cos(pitch), np.sin(pitch)
        cg, sg = np.cos(steer), np.sin(steer)

        def up(x: float, y: float, z: float) -> float:
            return float(np.sin(lean) * y + ct * (-sb * x + cb * z))

        def steered(x: float, z: float) -> float:
            along = sl * -(x - xa) + cl * (z - za)  # of the steer axis, and across it, forward
            across = cl * (x - xa) + sl * (z - za)
            return up(
                xa + cl * across * cg - sl * along, across * sg, za + sl * across * cg + cl * along
            )

        centre = r_r * ct
        above = [0.0, up(x3, 0.0, z3), steered(x4, z4), steered(x5, z5)]
        return np.asarray(centre + np.array(above))

    def _factor(self, D: Array, order: NDArray[np.int64], q: Array) -> None:
        if not factor(D, 9, order):
            raise KinematicsError(
                f"lean, wheel and steer do not fix the motion at lean {q[3]:.3f}, steer {q[6]:.3f} rad"
            )


def _wide(values: ArrayLike) -> Array:
    out = np.zeros(12)
    given = np.asarray(values, dtype=float)
    out[: len(given)] = given
    return out
