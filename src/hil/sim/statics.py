"""Forces that hold a rig still, compiled."""

from __future__ import annotations

import numpy as np

from hil.compiled import compiled, inner
from hil.rigs.kernel import scratch, terms_in
from hil.rigs.linear import solve_square


@compiled
def statics_memory(n):  # type: ignore[no-untyped-def]
    """What `static_forces` works in, kept by its caller."""
    matrices = (np.empty((n, n)), np.empty((n, n)), np.empty((n, n)))
    return matrices, (np.empty(n), np.empty(n), np.zeros(n)), scratch(n)


@inner
def static_forces(memory, kind, geometry, body, legs, gravity, q, out):  # type: ignore[no-untyped-def]
    """Actuator forces that hold pose q (n,), into out (n,): J^T F = h(q, 0)."""
    n = q.shape[0]
    (M, J, A), (rho, jdqd, still), own = memory
    terms_in(own, kind, geometry, body, legs, gravity, q, still, M, out, rho, J, jdqd)
    for a in range(n):
        for b in range(n):
            A[a, b] = J[b, a]
    solve_square(A, out)
