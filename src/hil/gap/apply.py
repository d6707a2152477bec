"""A diagnosis written into a rig file: effects with their parameters, and where they come from.

The file keeps its comments and its order. A parameter that stands there already gets the diagnosed value
in its place: the twin that was fitted had the file's own effects in it, so what it found is the whole. Where
that twin had habits of the rig (`hil.gap.located.habits`), so has the file then.
"""

from __future__ import annotations

import math
import re
import tomllib
from collections.abc import Mapping, Sequence
from typing import Any, Final

import tomlkit

from hil.config import AnyRig, BicycleFile
from hil.configfile import parse_any_rig
from hil.effectlines import check_effects
from hil.errors import ConfigError
from hil.gap.catalogue.nature import RIDER
from hil.identify.estimate.rigfile import set_value
from hil.rigs.bicycle import with_usual_rider
from hil.units import with_unit

FORMAT: Final = "hil-diagnosis/1"
PICKABLE: Final = 0.001
"""Probability from which on a cause is offered."""

_CHANGED: Final = r"; \w+ was "
"""Begins, in a provenance, what stood there before."""

Answer = Mapping[str, Any]


def applied_text(
    text: str, answer: Answer, *, when: str, source: str = "", pick: Sequence[str] = ()
) -> str:
    """Rig file `text` with the effects of a diagnosis (hil-diagnosis/1, plain tables) and habits of the rig.

    `when`: a date, `source`: the diagnosis's name, both for the provenance. `pick`: causes by
    "location.effect", instead of the verdict's set. ConfigError where the verdict is no cause to act on and
    none is picked, where rig and diagnosis do not belong together, or where the rig that comes out cannot be.
    """
    doc: Any = tomlkit.parse(text)
    rig = parse_any_rig(tomllib.loads(text), "rig file")
    for cause in chosen_causes(answer, rig, pick):
        if cause["effect"] == RIDER and isinstance(rig, BicycleFile):
            _write_rider(doc, rig)
        _write(doc, cause, *_provenance(answer, cause, when, source))
    for finding in habits_of(answer):
        _write_habit(doc, rig, finding, _origin(answer, when, source))
    new = tomlkit.dumps(doc)
    checked = parse_any_rig(tomllib.loads(new), f"{rig.name} with what was diagnosed")
    check_effects(checked, f"{rig.name} with what was diagnosed")
    return new


def habits_of(answer: Answer) -> list[Answer]:
    """The findings about what the rig has or does, unlike the file that was diagnosed."""
    return [f for f in answer.get("findings", ()) if "belongs" in f]


def chosen_causes(answer: Answer, rig: AnyRig, pick: Sequence[str]) -> list[Answer]:
    """The causes to be written, checked against the rig file; none where only habits were found."""
    if answer.get("format") != FORMAT:
        raise ConfigError(f"is no diagnosis: its format is {answer.get('format')!r}, not {FORMAT}")
    if answer["rig"] != rig.name:
        raise ConfigError(
            f"the diagnosis is of the rig {answer['rig']!r}, the file of {rig.name!r}"
        )
    causes = {f"{c['location']}.{c['effect']}": c for c in answer.get("causes", ())}
    if pick:
        missing = [p for p in pick if p not in causes]
        if missing:
            known = ", ".join(causes) or "none"
            raise ConfigError(
                f"{', '.join(missing)}: not among the causes weighed, which are {known}"
            )
        return [causes[p] for p in dict.fromkeys(pick)]
    verdict = answer["verdict"]
    if verdict == "no_gap" and habits_of(answer):
        return []
    if verdict == "no_gap":
        raise ConfigError("the verdict is no_gap: there is nothing to apply")
    if verdict != "identified":
        offered = [
            f"{name} (p = {c['probability']:.2f})"
            for name, c in causes.items()
            if c["probability"] > PICKABLE
        ]
        raise ConfigError(
            f"the verdict is {verdict}, so nothing is applied by itself; pick a cause with --pick: "
            f"{', '.join(offered) or 'none was weighed'}"
        )
    return list(answer["effects"])


def _write_habit(doc: Any, rig: AnyRig, finding: Answer, origin: str) -> None:
    """What belongs at a finding's key, at every actuator where the table is theirs; the rest stays."""
    table, key = finding["subject"].split(".")
    owner, value = getattr(rig, table), finding["belongs"]
    if not isinstance(owner, tuple):
        place = doc.setdefault(table, tomlkit.table())
        set_value(place, key, _written(value), f"was {getattr(owner, key)}; {origin}")
        return
    for line, actuator, own in zip(doc[table], owner, value, strict=True):
        before = getattr(actuator, key)
        if isinstance(own, Mapping):
            if dict(own) != before.model_dump():
                set_value(line, key, _written(own), f"weighed nothing; {origin}")
        elif own != before:
            set_value(line, key, own, f"was {before}; {origin}")


def _written(value: Any) -> Any:
    """A value as a rig file has it: a table in one line, its numbers to three digits."""
    if not isinstance(value, Mapping):
        return value

    def rounded(x: Any) -> Any:
        if isinstance(x, list | tuple):
            return [rounded(each) for each in x]
        return x if isinstance(x, bool) else float(f"{x:.3g}")

    inline = tomlkit.inline_table()
    inline.update({key: rounded(x) for key, x in value.items()})
    return inline


def alarms(causes: Sequence[Answer]) -> list[str]:
    """What must be said about causes that are applied: parameters that stand at their bounds."""
    return [
        f"{c['location']}.{c['effect']}.{name} stands at its bound, "
        + with_unit(f"{p['value']:.6g}", p["unit"])
        for c in causes
        for name, p in c["parameters"].items()
        if p.get("at_bound")
    ]


def _write_rider(doc: Any, rig: BicycleFile) -> None:
    """The rider that was assumed, into a file that says nothing of one."""
    ridden = with_usual_rider(rig)
    if ridden is None:
        return
    table = doc["rider"] = tomlkit.table()
    table.comment("a usual one, as the diagnosis assumed [R]")
    table.update({k: list(v) if isinstance(v, tuple) else v for k, v in ridden.rider})


def _provenance(answer: Answer, cause: Answer, when: str, source: str) -> tuple[str, list[str]]:
    """(the line's own words, a comment a parameter)."""
    parts = [
        _origin(answer, when, source),
        f"{answer['verdict']}, p = {cause['probability']:.2f}",
    ]
    shrink, ci = answer["gap"].get("shrink"), answer["gap"].get("shrink_ci")
    if shrink is not None:
        far = f"{100.0 * shrink:.0f} % of the gap gone on held-out data"
        if ci:
            far += f" ({100.0 * ci[0]:.0f} .. {100.0 * ci[1]:.0f} %)"
        parts.append(far)
    comments = [
        with_unit(f"{name}: {p['ci'][0]:.5g} .. {p['ci'][1]:.5g}", p["unit"]) + " (90 %)"
        for name, p in cause["parameters"].items()
    ]
    return "; ".join(parts), comments


def _origin(answer: Answer, when: str, source: str) -> str:
    """Which runs were diagnosed, when, in which file that is kept."""
    origin = f"hil gap diagnose, {', '.join(answer['runs'])}, {when}"
    return f"{origin} ({source})" if source else origin


def _write(doc: Any, cause: Answer, source: str, comments: Sequence[str]) -> None:
    """Into the effect's line if it has one, else into a new one at the end."""
    values = {name: _rounded(p["value"], p["ci"]) for name, p in cause["parameters"].items()}
    lines = doc.get("effects")
    if lines is None:
        doc.add(tomlkit.nl())
        lines = doc["effects"] = tomlkit.aot()
    note = "; ".join(comments)
    line = next(
        (x for x in lines if x["effect"] == cause["effect"] and x["location"] == cause["location"]),
        None,
    )
    if line is not None:
        _replace(line, values, source)
    elif values:
        inline = not isinstance(lines, tomlkit.items.AoT)
        line = tomlkit.inline_table() if inline else tomlkit.table()
        if not inline:
            line.add(tomlkit.comment(note))
        line.add("effect", cause["effect"])
        line.add("location", cause["location"])
        parameters = tomlkit.inline_table()
        parameters.update(values)
        line.add("parameters", parameters)
        line.add("provenance", source)
        lines.append(line)


def _replace(line: Any, values: Mapping[str, float], source: str) -> None:
    """Put `values` in the place of a line's own; its provenance says what they were, one step back."""
    before = {name: float(x) for name, x in line["parameters"].items() if name in values}
    changed = [f"{name} was {x:.6g}" for name, x in before.items() if x != values[name]]
    own = re.split(_CHANGED, line.get("provenance", ""), maxsplit=1)[0]
    line["parameters"].update(values)
    line["provenance"] = f"{source}; {', '.join(changed)}: {own}" if changed else source


def _rounded(value: float, ci: Sequence[float]) -> float:
    """To a hundredth of the interval: more digits would be noise."""
    width = abs(float(ci[1]) - float(ci[0]))
    if not (width > 0.0 and math.isfinite(width) and math.isfinite(value)):
        return float(value)
    return float(round(value, 2 - math.floor(math.log10(width))))
