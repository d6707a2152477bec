"""Forces that hold a rig still, and the small linear solver for it, compiled."""

from __future__ import annotations

import numpy as np

from hil.compiled import compiled
from hil.rigs.kernel import terms


@compiled
def solve_square(A, b):  # type: ignore[no-untyped-def]
    """b <- A^-1 b by elimination with partial pivoting; A is overwritten."""
    n = b.shape[0]
    for k in range(n):
        p = k
        for i in range(k + 1, n):
            if abs(A[i, k]) > abs(A[p, k]):
                p = i
        if p != k:
            for j in range(n):
                A[k, j], A[p, j] = A[p, j], A[k, j]
            b[k], b[p] = b[p], b[k]
        for i in range(k + 1, n):
            f = A[i, k] / A[k, k]
            for j in range(k, n):
                A[i, j] -= f * A[k, j]
            b[i] -= f * b[k]
    for k in range(n - 1, -1, -1):
        for j in range(k + 1, n):
            b[k] -= A[k, j] * b[j]
        b[k] /= A[k, k]


@compiled
def static_forces(kind, geometry, body, legs, gravity, q, out):  # type: ignore[no-untyped-def]
    """Actuator forces that hold pose q (n,), into out (n,): J^T F = h(q, 0)."""
    n = q.shape[0]
    M, J, A = np.empty((n, n)), np.empty((n, n)), np.empty((n, n))
    rho, jdqd = np.empty(n), np.empty(n)
    terms(kind, geometry, body, legs, gravity, q, np.zeros(n), M, out, rho, J, jdqd)
    for a in range(n):
        for b in range(n):
            A[a, b] = J[b, a]
    solve_square(A, out)
