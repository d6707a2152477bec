"""Small dense solves (n <= 6) for compiled code, in place and without allocation."""

from __future__ import annotations

import math

from hil.compiled import inner


@inner
def solve_positive(M, b):  # type: ignore[no-untyped-def]
    """Solve M x = b, M (n,n) symmetric positive definite, by Cholesky; b (n,) becomes x.

    M becomes its factor. False where M is not positive definite; b is then worthless.
    """
    n = b.shape[0]
    for j in range(n):
        s = M[j, j]
        for c in range(j):
            s -= M[j, c] * M[j, c]
        if not s > 0.0:
            return False
        d = math.sqrt(s)
        M[j, j] = d
        for i in range(j + 1, n):
            s = M[i, j]
            for c in range(j):
                s -= M[i, c] * M[j, c]
            M[i, j] = s / d
    for i in range(n):
        s = b[i]
        for c in range(i):
            s -= M[i, c] * b[c]
        b[i] = s / M[i, i]
    for i in range(n - 1, -1, -1):
        s = b[i]
        for c in range(i + 1, n):
            s -= M[c, i] * b[c]
        b[i] = s / M[i, i]
    return True


@inner
def solve_square(A, b):  # type: ignore[no-untyped-def]
    """Solve A x = b, A (n,n) any square matrix, by elimination with row pivots; b (n,) becomes x.

    A is spent. False where A is singular; b is then worthless.
    """
    n = b.shape[0]
    for j in range(n):
        p = j
        for i in range(j + 1, n):
            if abs(A[i, j]) > abs(A[p, j]):
                p = i
        if not abs(A[p, j]) > 0.0:
            return False
        if p != j:
            for c in range(n):
                A[j, c], A[p, c] = A[p, c], A[j, c]
            b[j], b[p] = b[p], b[j]
        for i in range(j + 1, n):
            x = A[i, j] / A[j, j]
            for c in range(j + 1, n):
                A[i, c] -= x * A[j, c]
            b[i] -= x * b[j]
    for i in range(n - 1, -1, -1):
        s = b[i]
        for c in range(i + 1, n):
            s -= A[i, c] * b[c]
        b[i] = s / A[i, i]
    return True
