"""What a diagnosis leaves open: the candidates with their probabilities and fitted parameters."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from hil.config import AnyRig
from hil.errors import IdentificationError
from hil.sim.parameters import ParameterTable

Array = NDArray[np.float64]

MOST: Final = 5
"""Candidates that are told apart at once; the least probable ones are left out."""
LEAST: Final = 0.02
"""Probability from which on a candidate is worth an experiment, if it is not in the first one's class."""
CERTAIN: Final = 0.9
"""Of several effects that act together: those as probable as that stand in every candidate."""
HOLDS: Final = {
    "asymmetric_friction": "coulomb_friction",
    "stribeck_friction": "coulomb_friction",
    "hysteresis": "coulomb_friction",
    "asymmetric_viscous_friction": "viscous_friction",
}
"""Laws that are another one where both directions are alike, no peak stands at rest, no way is needed."""


@dataclass(frozen=True, slots=True)
class Candidate:
    """One effect at one place that may be it."""

    effect: str
    location: str
    probability: float
    """Among the candidates; they sum to 1."""
    values: Mapping[str, float]
    """Fitted parameters by full name, as the twin's vector has them."""

    @property
    def name(self) -> str:
        """`effect at location`, in words."""
        return f"{self.effect.replace('_', ' ')} at {self.location}"

    def holds(self, other: Candidate) -> bool:
        """Whether `other` is a special case of it."""
        return self.location == other.location and HOLDS.get(self.effect) == other.effect


def simplest(candidates: Sequence[Candidate]) -> Candidate | None:
    """The candidate that all others hold as a special case; None where there is none."""
    return next(
        (c for c in candidates if all(x is c or x.holds(c) for x in candidates)),
        None,
    )


def read_candidates(
    tables: Mapping[str, Any], rig: AnyRig
) -> tuple[list[Candidate], dict[str, float]]:
    """Candidates of a diagnosis (format hil-diagnosis/1), best first, and the values that all of them share.

    IdentificationError where there are no two: nothing is open, or nothing was found.
    """
    if tables.get("format") != "hil-diagnosis/1":
        raise IdentificationError("this is no diagnosis: its format is not hil-diagnosis/1")
    if tables.get("rig") != rig.name:
        raise IdentificationError(
            f"the diagnosis is of {tables.get('rig')}, the rig file of {rig.name}"
        )
    causes: Sequence[Mapping[str, Any]] = tables.get("causes") or ()
    verdict = tables.get("effects") or ()
    known = ParameterTable(rig)
    shared: dict[str, float] = {}
    certain = set()
    if len(verdict) > 1:
        for c in verdict:
            if c["probability"] >= CERTAIN:
                shared.update(_values(c, known))
                certain.add((c["effect"], c["location"]))
    open_ones = [
        c for c in causes if (c["effect"], c["location"]) not in certain and c["parameters"]
    ]
    open_ones.sort(key=lambda c: -c["probability"])
    chosen = [
        c for c in open_ones
        if c["probability"] >= LEAST or c.get("class") == open_ones[0].get("class")
    ][:MOST]  # fmt: skip
    if len(chosen) < 2:
        what = (
            "no candidate"
            if not chosen
            else f"only {chosen[0]['effect']} at {chosen[0]['location']}"
        )
        raise IdentificationError(
            f"the diagnosis ({tables.get('verdict')}) leaves {what}: there is nothing to tell apart"
        )
    p = np.maximum([c["probability"] for c in chosen], LEAST)
    p /= p.sum()
    return [
        Candidate(c["effect"], c["location"], float(w), _values(c, known))
        for c, w in zip(chosen, p, strict=True)
    ], shared


def _values(cause: Mapping[str, Any], known: ParameterTable) -> dict[str, float]:
    out = {}
    for name, entry in cause["parameters"].items():
        full = f"{cause['location']}.{cause['effect']}.{name}"
        known.index(full)
        out[full] = float(entry["value"] if isinstance(entry, Mapping) else entry)
    return out


def vector_of(
    candidate: Candidate, shared: Mapping[str, float], base: Array, known: ParameterTable
) -> Array:
    """`base` (P of the table,) with the candidate's parameters."""
    out = np.array(base)
    for name, value in {**shared, **candidate.values}.items():
        out[known.index(name)] = value
    return out
