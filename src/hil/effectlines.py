"""Whether the effects of a rig file are such that its model has: names, bounds, nothing twice or empty.

The file's own check (`hil.configfile`) cannot know: the catalogue of effects is the model's.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

from hil.config import AnyRig, Effect
from hil.configfile import find_rig_file
from hil.errors import ConfigError
from hil.units import with_unit

if TYPE_CHECKING:
    from hil.sim.parameters import Parameter

R = TypeVar("R", bound=AnyRig)


def checked(rig: R, name: str | Path) -> R:
    """`rig`, read of the file that `name` stands for; ConfigError names file, key and bound of each fault."""
    if rig.effects:
        check_effects(rig, str(find_rig_file(str(name))))
    return rig


def effect_names(rig: AnyRig) -> tuple[str, ...]:
    """The effects of `rig`'s model, in the catalogue's order."""
    from hil.sim.parameters import ParameterTable

    return tuple(dict.fromkeys(p.effect for p in ParameterTable(rig).entries))


def check_effects(rig: AnyRig, source: str) -> None:
    """ConfigError with a line for each fault of `rig`'s effects; `source` is the file."""
    from hil.sim.parameters import ParameterTable  # half a second, which most rig files need not

    entries = ParameterTable(rig).entries
    faults: list[str] = []
    first: dict[tuple[str, str], int] = {}
    for k, line in enumerate(rig.effects):
        known = first.setdefault((line.location, line.effect), k)
        if known != k:
            text = f": {line.effect} at {line.location} stands there already, as effects[{known}]"
            faults.append(f"effects[{k}]{text}: write one line with all parameters")
        else:
            faults += [f"effects[{k}].{fault}" for fault in _faults(line, entries)]
    if faults:
        raise ConfigError("\n".join(f"{source}: {fault}" for fault in faults))


def _faults(line: Effect, entries: Iterable[Parameter]) -> list[str]:
    """What is wrong with one line, from its key on."""
    places = dict.fromkeys(p.location for p in entries)
    if line.location not in places:
        meant = _nearest(line.location, places)
        return [f"location: {line.location!r} is no place of this rig's model{meant}"]
    here = dict.fromkeys(p.effect for p in entries if p.location == line.location)
    if line.effect not in here:
        others = [p.location for p in entries if p.effect == line.effect]
        if others:
            acts = ", ".join(dict.fromkeys(others))
            return [f"effect: {line.effect!r} does not act at {line.location!r}, but at {acts}"]
        return [
            f"effect: {line.effect!r} is none of the catalogue{_nearest(line.effect, here)}; "
            f"{line.location} may have {', '.join(here)}"
        ]
    mine = {
        p.parameter: p for p in entries if p.location == line.location and p.effect == line.effect
    }
    if not line.parameters:
        return [f"parameters: is empty, so {line.effect} does nothing; it has {', '.join(mine)}"]
    faults = []
    for name, value in line.parameters.items():
        p = mine.get(name)
        if p is None:
            faults.append(
                f"parameters.{name}: {line.effect} has no such parameter; it has {', '.join(mine)}"
            )
        elif not p.lower <= value <= p.upper:
            given, bounds = with_unit(f"{value:g}", p.unit), f"{p.lower:g}..{p.upper:g}"
            faults.append(
                f"parameters.{name}: {given} lies outside {with_unit(bounds, p.unit)} "
                f"({line.effect} at {line.location})"
            )
    return faults


def _nearest(name: str, known: Iterable[str]) -> str:
    near = difflib.get_close_matches(name, list(known), 3)
    return f"; nearest: {', '.join(near)}" if near else f"; it has {', '.join(known)}"
