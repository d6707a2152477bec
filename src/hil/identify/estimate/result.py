"""What an identification hands over: values, intervals, what cannot be told and why."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import msgspec
import numpy as np
from numpy.typing import NDArray
from scipy import stats

from hil.identify.estimate.directions import Analysis, Direction

Array = NDArray[np.float64]
FORMAT: Final = "hil-identification/1"
WEAK: Final = 0.5
"""A 95 % interval wider to one side than this share of the parameter's scale tells little [R]."""


class Estimate(msgspec.Struct, frozen=True, kw_only=True):
    """One parameter."""

    name: str
    unit: str
    value: float
    nominal: float
    """What the rig file says."""
    std: float
    ci90: tuple[float, float]
    ci95: tuple[float, float]
    identifiable: bool
    reason: str
    """Why these data cannot tell it, what to do; empty where they can."""


class Identification(msgspec.Struct, frozen=True, kw_only=True):
    """A whole result; JSON by `to_json`."""

    rig: str
    runs: tuple[str, ...]
    method: str
    estimates: tuple[Estimate, ...]
    fit: dict[str, float]
    """By signal: residual's root mean square as a share of the signal's own about its mean."""
    rank: int
    condition: float
    untold: tuple[str, ...]
    """Combinations of parameters that these data leave open, worst first."""
    effective_samples: float
    notes: tuple[str, ...] = ()
    """What a reader has to know: warnings, corrections, bounds."""
    format: str = FORMAT

    def __getitem__(self, name: str) -> Estimate:
        """The estimate of parameter `name`."""
        return next(e for e in self.estimates if e.name == name)

    def to_json(self) -> bytes:
        """As JSON; infinite numbers become null."""
        return msgspec.json.format(
            msgspec.json.encode(_finite(msgspec.to_builtins(self))), indent=2
        )

    def write(self, path: Path) -> None:
        """Write the JSON to `path`."""
        path.write_bytes(self.to_json() + b"\n")


def estimates(
    rows: list[tuple[str, str, float, float]],
    values: Array,
    covariance: Array,
    dof: float,
    analysis: Analysis,
    reasons: dict[str, str],
) -> tuple[Estimate, ...]:
    """Estimates of `rows` (name, unit, nominal, scale) with Student intervals of `dof` degrees of freedom.

    `reasons`: parameters known from elsewhere to be out of reach, and why.
    """
    out = []
    std = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    entangled = _entangled(covariance)
    for (name, unit, nominal, scale), value, s, tied in zip(
        rows, values, std, entangled, strict=True
    ):
        half90, half95 = (float(stats.t.ppf(0.5 + 0.5 * c, dof)) * s for c in (0.90, 0.95))
        untold = analysis.about(name) if tied else None
        reason = reasons.get(name) or _reason(name, unit, half95, scale, untold)
        out.append(
            Estimate(
                name=name, unit=unit, value=float(value), nominal=float(nominal), std=float(s),
                ci90=(float(value - half90), float(value + half90)),
                ci95=(float(value - half95), float(value + half95)),
                identifiable=not reason, reason=reason,
            )
        )  # fmt: skip
    return tuple(out)


def _entangled(covariance: Array) -> NDArray[np.bool_]:
    """(P,) whether a parameter would be told at least thrice as well if the others were known."""
    std = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    relative = covariance / np.outer(std, std)
    alone = np.diag(np.linalg.inv(relative + 1e-12 * np.eye(len(std))))
    tied: NDArray[np.bool_] = alone > 9.0
    return tied


def _reason(name: str, unit: str, half: float, scale: float, untold: Direction | None) -> str:
    if half <= WEAK * scale:
        return ""
    if untold is not None and len(untold.parts) > 1:
        others = [n for n in untold.parts if n != name]
        return (
            f"these data do not tell {name} apart from {', '.join(others)}: only other combinations than "
            f"{untold.text} (in units of their sizes) are determined"
        )
    if half > 1e3 * scale:
        return f"these data say nothing of {name}: play a motion that depends on it"
    return (
        f"these data leave ±{half:.3g} {unit} (95 %), over half of its size {scale:.3g}: play a "
        "longer or stronger motion of what it acts on"
    )


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {k: _finite(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(v) for v in value]
    if isinstance(value, float) and not np.isfinite(value):
        return None
    return value
