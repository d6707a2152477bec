"""What may be claimed where effects were withheld: any of them may be it, and nobody has looked."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from dataclasses import replace
from typing import Final

from hil.gap.judged.diagnosis import Cause, Diagnosis

UNTRIED: Final = 0.2
"""Chance at least that what was found is an effect that was not tried: of records whose very effect was
withheld half get the name of a relative [52 of 105 on used-up exams: seeds 114 (axis), 614 and 615 (rides)],
and one record in three from which an effect is withheld is taken to have it [by judgement]."""
TOLD: Final = 3
"""Withheld effects that are listed; more are counted."""


def beside_untried(found: Diagnosis, without: Collection[str]) -> Diagnosis:
    """`found` with what it claims held back for the effects in `without`, which were not tried."""
    if not without or not found.effects:
        return found
    unknown = max(found.unknown, UNTRIED)
    factor = (1.0 - unknown) / max(1.0 - found.unknown, 1e-12)

    def held_back(causes: Iterable[Cause]) -> tuple[Cause, ...]:
        return tuple(replace(x, probability=x.probability * factor) for x in causes)

    return replace(
        found,
        sentence=f"{found.sentence} It may also be what was not tried: {_listed(without)}.",
        causes=held_back(found.causes),
        effects=held_back(found.effects),
        unknown=unknown,
    )


def _listed(without: Collection[str]) -> str:
    names = sorted(x.replace("_", " ") for x in without)
    if len(names) > TOLD:
        return f"any of {len(names)} other effects of the catalogue"
    return ", ".join(names)
