"""The adaptive-gradient law: parameters that follow the data one instant at a time, off-line or live.

p' = K Y^T (tau - Y p), "Parameters Identification for Motorcycle Simulator's Platform Characterization",
(35)-(36). In steps of dt it is stable only while 0 < dt eig(K Y^T Y) < 2 at every instant; the normalised
update p += K Y^T e / (1 + tr(Y K Y^T)) keeps that for any step and any K > 0 [V].
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hil.errors import IdentificationError
from hil.identify.estimate.regression import Regression

Array = NDArray[np.float64]
LIMIT = 2.0
DIVERGED = 1e9
"""Of a parameter's scale."""


class AdaptiveGradient:
    """The law as a step function, pure: `update` once an instant, live or from a record."""

    def __init__(self, start: Array, gain: Array, *, normalised: bool = True) -> None:
        """`start` (P,) first guess; `gain` K: (P,) diagonal, or (P, P) symmetric positive definite."""
        self.values: Array = np.array(start, dtype=float)
        """(P,) present parameters."""
        self._K = np.diag(gain) if np.ndim(gain) == 1 else np.array(gain, dtype=float)
        if self._K.shape != (len(start), len(start)) or np.linalg.eigvalsh(self._K)[0] <= 0.0:
            raise ValueError("gain must be positive: (P,) or symmetric positive definite (P, P)")
        self._normalised = normalised
        self.worst = 0.0
        """Largest dt eig(K Y^T Y) so far: stable below 2."""

    def update(self, Y: Array, tau: Array, dt_s: float = 1.0) -> Array:
        """One instant: rows Y (n, P) and what was measured tau (n,). Returns the error before the step.

        `dt_s` counts only without normalisation.
        """
        error: Array = tau - Y @ self.values
        spread = Y @ self._K @ Y.T
        # the non-zero eigenvalues of K Y^T Y are those of Y K Y^T
        step = 1.0 / (1.0 + float(np.trace(spread))) if self._normalised else dt_s
        self.worst = max(self.worst, step * float(np.linalg.eigvalsh(spread)[-1]))
        self.values = self.values + step * (self._K @ Y.T @ error)
        return error

    @property
    def is_stable(self) -> bool:
        """Whether every step so far kept to the bound."""
        return self.worst < LIMIT


def stability_bound_s(Y: Array, gain: Array) -> float:
    """Longest step for which the plain law is stable on all rows Y (N, n, P) with diagonal gain (P,), s."""
    spread = np.einsum("tip,p,tjp->tij", Y, gain, Y)
    top = float(np.linalg.eigvalsh(spread)[:, -1].max())
    return LIMIT / top if top > 0.0 else float("inf")


@dataclass(frozen=True, slots=True)
class AdaptiveRun:
    """What the law made of a record."""

    values: Array
    """(P,) mean over the last pass, in which single steps still wander."""
    history: Array
    """(passes, P) values after each pass."""
    worst: float
    """Largest dt eig(K Y^T Y): stable below 2."""
    settled: Array
    """(P,) change over the last pass, in units of each parameter's scale."""


def adapt(
    problem: Regression,
    sigma_n: Array,
    *,
    gain: float = 1.0,
    passes: int = 20,
    dt_s: float | None = None,
) -> AdaptiveRun:
    """Run the law off-line over `problem`, `passes` times, from the rig file's values.

    Rows are weighed by 1 / sigma_n (n,), parameters by their scale; `gain` is K in these units.
    `dt_s`: the plain law with this step instead of the normalised one; IdentificationError names the bound
    where that diverges.
    """
    rows = problem.weighted(sigma_n)
    scale = problem.scale
    Y = np.where(rows.keep[:, :, None], rows.W * scale, 0.0)
    tau = np.where(rows.keep, rows.y, 0.0)
    law = AdaptiveGradient(
        problem.nominal / scale, np.full(len(scale), gain), normalised=dt_s is None
    )
    history = np.empty((passes, len(scale)))
    for k in range(passes):
        total = np.zeros(len(scale))
        for row, measured in zip(Y, tau, strict=True):
            law.update(row, measured, 1.0 if dt_s is None else dt_s)
            if not np.all(np.abs(law.values) < DIVERGED):
                bound = stability_bound_s(Y, np.full(len(scale), gain))
                raise IdentificationError(
                    f"the adaptive law diverges: dt eig(K Y'Y) reached {law.worst:.3g}, stable is below "
                    f"{LIMIT:g}. Take steps below {bound:.3g} s, a smaller gain, or the normalised law"
                )
            total += law.values
        history[k] = total / len(Y)
    before = history[-2] if passes > 1 else problem.nominal / scale
    return AdaptiveRun(
        history[-1] * scale, history * scale, law.worst, np.abs(history[-1] - before)
    )
