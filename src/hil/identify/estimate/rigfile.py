"""The rig file with what was identified: comments kept, every new number with where it comes from."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from typing import Any, Final

import numpy as np
import tomlkit
from tomlkit.items import Item

from hil.config import RigFile
from hil.configfile import parse_settings
from hil.errors import IdentificationError
from hil.identify.estimate.fit import body_numbers
from hil.identify.estimate.names import AXES, FORCE_GAIN, GROUP, force_gains, is_rig_number
from hil.identify.estimate.result import Estimate, Identification

_LINEAR_BODY: Final = ("mass.first_moment.", "mass.origin_inertia.")


def updated_rig_text(text: str, result: Identification, when: str) -> str:
    """Rig file `text` with the identified values of `result`; `when` (a date) goes into the provenance.

    Only what these data tell is written. IdentificationError where that is nothing, ConfigError where the
    rig that comes out cannot be (a negative mass).
    """
    doc: Any = tomlkit.parse(text)
    rig = parse_settings(tomllib.loads(text), RigFile, "rig file")
    source = f"{result.method}, {', '.join(result.runs)}, {when}"
    told = {e.name: e for e in result.estimates if e.identifiable}
    written = [_write(doc, rig, e, source) for e in told.values() if is_rig_number(rig, e.name)]
    written += [
        _write_effect(doc, e, source)
        for e in told.values()
        if not is_rig_number(rig, e.name) and not e.name.startswith(_LINEAR_BODY)
    ]
    written += _write_body(doc, told, source)
    if not any(written):
        raise IdentificationError(
            f"{result.rig}: these data tell none of the parameters, so no rig file was written"
        )
    note = str(doc.get("note", ""))
    doc["note"] = (note + " " if note else "") + f"Identified: {source}."
    new = tomlkit.dumps(doc)
    parse_settings(tomllib.loads(new), RigFile, f"{result.rig} with what was identified")
    return new


def _comment(e: Estimate, source: str) -> str:
    return f"{e.ci95[0]:.5g} .. {e.ci95[1]:.5g} (95 %), was {e.nominal:.6g}; {source}"


def set_value(table: Any, key: str, value: Any, comment: str) -> bool:
    """Replace a value of a TOML table; what its line said in a comment stays, `comment` follows."""
    item: Item = tomlkit.item(value)
    before = table[key].trivia.comment.removeprefix("#").strip() if key in table else ""
    item.comment(f"{before}; {comment}" if before else comment)
    table[key] = item
    return True


def _write(doc: Any, rig: RigFile, e: Estimate, source: str) -> bool:
    head, _, field = e.name.partition(".")
    value, comment = _rounded(e.value, e.std), _comment(e, source)
    if e.name == "mass.m":
        return set_value(doc["mass"], "m", value, comment)
    if field.startswith("cog."):
        cog = list(doc["mass"].get("cog", [0.0, 0.0, 0.0]))
        cog[AXES[field[-1]]] = value
        return set_value(doc["mass"], "cog", cog, f"{field}: {comment}")
    if head == "mass":
        inertia = [list(row) for row in doc["mass"]["inertia"]]
        i, j = AXES[field[-2]], AXES[field[-1]]
        inertia[i][j] = inertia[j][i] = value
        return set_value(doc["mass"], "inertia", inertia, f"{field}: {comment}")
    if head == "bus":
        if "bus" not in doc:
            doc["bus"] = tomlkit.table()
        return set_value(doc["bus"], field, value, comment)
    for table, actuator in zip(doc["actuators"], rig.actuators, strict=True):
        if head not in (GROUP, actuator.name):
            continue
        if e.name == FORCE_GAIN:
            for gain in force_gains(actuator.law):
                own = getattr(actuator, gain)
                set_value(table, gain, _rounded(own * e.value, own * e.std), f"x {comment}")
        else:
            set_value(table, field, value, comment)
    return True


def _write_effect(doc: Any, e: Estimate, source: str) -> bool:
    place, _, parameter = e.name.rpartition(".")
    location, _, effect = place.rpartition(".")
    lines = doc.get("effects")
    if lines is None:
        lines = doc["effects"] = tomlkit.aot()
    for line in lines:
        if line["effect"] == effect and line["location"] == location:
            line["parameters"][parameter] = _rounded(e.value, e.std)
            line["provenance"] = source
            return True
    line = tomlkit.table()
    line["effect"], line["location"] = effect, location
    line["parameters"] = {parameter: _rounded(e.value, e.std)}
    line["provenance"] = source
    lines.append(line)
    return True


def _write_body(doc: Any, told: Mapping[str, Estimate], source: str) -> list[bool]:
    """Centre of gravity and inertia about it, where all ten parameters of the body are told."""
    if sum(name.startswith(_LINEAR_BODY) for name in told) < 9 or "mass.m" not in told:
        return []
    values = body_numbers({name: e.value for name, e in told.items()})
    cog = [round(values[f"mass.cog.{c}"], 5) for c in "xyz"]
    inertia = np.empty((3, 3))
    for key in ("xx", "yy", "zz", "xy", "xz", "yz"):
        i, j = AXES[key[0]], AXES[key[1]]
        inertia[i, j] = inertia[j, i] = round(values[f"mass.inertia.{key}"], 4)
    set_value(doc["mass"], "cog", cog, source)
    set_value(doc["mass"], "inertia", inertia.tolist(), source)
    return [True]


def _rounded(value: float, std: float) -> float:
    """To two digits below the standard deviation."""
    if not std > 0.0 or not np.isfinite(std):
        return value
    return float(round(value, max(0, 2 - int(np.floor(np.log10(std))))))
