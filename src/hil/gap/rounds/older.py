"""What references show already: a diagnosis against another time starts from the rig as it was then."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from hil.config import Effect
from hil.gap.judged.diagnosis import Cause, Diagnosis
from hil.gap.located.sanity import Finding
from hil.units import with_unit


def as_it_was(effects: Sequence[Effect], was: Diagnosis) -> tuple[tuple[Effect, ...], Finding]:
    """A rig file's `effects` with what the diagnosis of its references named in their place, and what the
    reader must know of that."""
    if not was.effects:
        worst = max(was.located.signals, key=lambda s: s.ratio)
        return tuple(effects), Finding(
            "warning", "references",
            f"stand {worst.ratio:.1f} floors from the twin in {worst.signal} themselves, and nothing in the "
            "catalogue explains that: what is found beside them may be as old",
        )  # fmt: skip
    found = {(x.effect, x.location): _line(x) for x in was.effects}
    kept = [e for e in effects if (e.effect, e.location) not in found]
    named = " and ".join(f"{_named(x)} at {x.location}" for x in was.effects)
    return (*kept, *found.values()), Finding(
        "warning", "references",
        f"differ from the rig file by {named} themselves: the twin starts from there, and a value of the "
        "same effect below is the whole of it",
    )  # fmt: skip


def by_itself(alone: Diagnosis, beside: Diagnosis) -> Diagnosis:
    """The diagnosis of runs without their references, in which there is no gap, told that `beside` those they
    stand off and nothing explains it: calibrations differ from day to day by as much."""
    worst = max(beside.located.signals, key=lambda s: s.ratio)
    told = Finding(
        "warning", "references",
        f"leave the twin {worst.ratio:.1f} floors off in {worst.signal} of these runs, and nothing explains "
        "that; the twin of the rig file fits them within a healthy rig's tolerances, and is what is judged",
    )  # fmt: skip
    located = replace(alone.located, findings=(*alone.located.findings, told))
    return replace(alone, located=located)


def _line(x: Cause) -> Effect:
    values = {name: p.value for name, p in x.parameters.items()}
    return Effect(effect=x.effect, location=x.location, parameters=values)


def _named(x: Cause) -> str:
    values = ", ".join(
        with_unit(f"{name} {p.value:.4g}", p.unit) for name, p in x.parameters.items()
    )
    return f"{x.effect.replace('_', ' ')} ({values})"
