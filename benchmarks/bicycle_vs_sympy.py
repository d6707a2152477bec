"""Cost of a 37 s ride of the bicycle at 100 Hz, beside the same equations as sympy's lambdify gives them.

Kinematics from the same symbolic derivation, lambdified with common subexpressions taken out; assembly and
solutions with numpy, as one would write it. Both answers are compared before anything is timed. The
lambdified ride is timed over a part and scaled.
"""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np
import sympy as sp

from benchmarks.figure import Options, Table
from hil.configfile import load_bicycle
from hil.rigs.bicycle import Packed, Smooth, derivation, pack, ride, smooth
from hil.rigs.bicycle.kernel import close_loop

RATE_HZ, SECONDS = 100.0, 37.0


class Lambdified:
    """Velocities, accelerations and multipliers of one sample by sympy and numpy."""

    def __init__(self, bicycle: Packed) -> None:
        found = derivation.derive()
        p, q, qd = derivation.symbols()
        parts = [
            sp.Matrix.vstack(*(m[:, :9] if m.shape[1] == 12 else m for m in found[n]))
            for n in ("H", "h", "G", "g", "spins", "frames")
        ]
        parts += [found["J"][:, :9], found["j"]]
        rigid = dict.fromkeys((*q[9:], *qd[9:]), 0)
        parts = [m.subs(rigid) for m in parts]
        self._numbers = bicycle
        self._call = sp.lambdify([p, q[:9], qd[:9]], parts, "numpy", cse=True)
        self._inertia = [
            np.array([[xx, 0.0, xz], [0.0, yy, 0.0], [xz, 0.0, zz]])
            for _, xx, yy, zz, xz in bicycle.body
        ]
        self._rows = np.zeros((3, 9))
        self._rows[0, 3] = self._rows[1, 4] = self._rows[2, 6] = 1.0
        if bicycle.encoder_on_frame:
            self._rows[1, 5] = -1.0

    def sample(
        self, q: np.ndarray, rate: np.ndarray, acceleration: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """qd, qdd and the nine multipliers at q."""
        p, body, extra = self._numbers.p, self._numbers.body, self._numbers.extra
        *_, J, _j = self._call(p, q, np.zeros(9))
        D = np.vstack([J, self._rows])
        qd = np.linalg.solve(D, np.concatenate([np.zeros(6), rate]))
        H, h, G, g, spin, frame, J, j = self._call(p, q, qd)
        D = np.vstack([J, self._rows])
        qdd = np.linalg.solve(D, np.concatenate([-np.ravel(j), acceleration]))
        M, Q = np.zeros((9, 9)), np.zeros(9)
        for b in range(4):
            part = slice(3 * b, 3 * b + 3)
            m, inertia = body[b, 0], self._inertia[b]
            M += m * H[part].T @ H[part] + G[part].T @ inertia @ G[part]
            force = -m * (np.ravel(h[part]) + np.array([0.0, 0.0, extra[0]]))
            if b == 1:
                v = H[part] @ qd
                force -= extra[1] * np.linalg.norm(v) * v
            turning = np.cross(np.ravel(frame[part]), inertia @ np.ravel(spin[part]))
            Q += H[part].T @ force - G[part].T @ (inertia @ np.ravel(g[part]) + turning)
        return qd, qdd, np.linalg.solve(D.T, Q - M @ qdd)


def told() -> Smooth:
    """Lean, wheel and steer of a ride with two turns."""
    t = np.arange(round(SECONDS * RATE_HZ)) / RATE_HZ
    bend = np.exp(-0.5 * ((t - 10.0) / 1.6) ** 2) + np.exp(-0.5 * ((t - 26.0) / 1.6) ** 2)
    return smooth(np.column_stack([-0.22 * bend, 14.0 * t, 0.1 * bend]), 1.0 / RATE_HZ)


def measure(options: Options) -> list[Table]:
    """Milliseconds a ride, and how many times faster."""
    bicycle, given = pack(load_bicycle("bicycle")), told()
    begun = time.perf_counter()
    motion = ride(bicycle, given)
    first_ms = 1e3 * (time.perf_counter() - begun)
    ours = min(_timed(lambda: ride(bicycle, given)) for _ in range(3 if options.quick else 20))
    begun = time.perf_counter()
    other = Lambdified(bicycle)
    derive_ms = 1e3 * (time.perf_counter() - begun)
    count = 40 if options.quick else 400
    rows = np.linspace(200, len(motion.q) - 1, count).astype(int)
    for k in rows[:5]:
        qd, qdd, multipliers = other.sample(motion.q[k, :9], given.rate[k], given.acceleration[k])
        np.testing.assert_allclose(qd, motion.qd[k, :9], atol=1e-9)
        np.testing.assert_allclose(qdd, motion.qdd[k, :9], atol=1e-8)
        np.testing.assert_allclose(multipliers, motion.multipliers[k], atol=1e-6)

    def part() -> None:
        c, dc, contact = np.zeros(2), np.zeros((2, 2)), np.zeros(3)
        for k in rows:
            q = motion.q[k].copy()
            close_loop(bicycle.p, q, c, dc, contact)
            other.sample(q[:9], given.rate[k], given.acceleration[k])

    theirs = min(_timed(part) for _ in range(3)) * len(motion.q) / count
    return [
        Table(
            f"A ride of {SECONDS:g} s at {RATE_HZ:g} Hz: kinematics, all multipliers, IMU",
            ("ms a ride", "times ours", "start, ms"),
            {
                "hil": (1e3 * ours, 1.0, first_ms),
                "sympy, lambdified": (1e3 * theirs, theirs / ours, derive_ms),
            },
            "start: hil's first ride, compiled code from the cache or not; sympy's derivation and lambdify",
        )
    ]


def _timed(action: Callable[[], object]) -> float:
    begun = time.perf_counter()
    action()
    return time.perf_counter() - begun
