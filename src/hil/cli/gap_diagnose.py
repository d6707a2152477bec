"""`hil gap diagnose`: which effect makes the gap, with what parameters, and how far the gap shrinks."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer
from rich.table import Column, Table

from hil.cli.console import err, out
from hil.cli.outputs import JsonFile, Outputs, Page
from hil.config import AnyRig, BicycleFile
from hil.configfile import load_any_rig
from hil.effectlines import checked, effect_names
from hil.errors import IdentificationError
from hil.gap import Cause, Diagnosis
from hil.gap.bicycle import diagnose_any
from hil.gap.bicycle.next import propose_ride
from hil.gap.next import next_experiment
from hil.runs import load_run
from hil.ui.diagnosis_page import diagnosis_page
from hil.units import with_unit

SHOWN = 0.001
"""Probability below which a candidate is counted and not listed."""
LISTED = 6
"""Names that a line gives before it counts the rest."""
STYLE = {"error": "red", "warning": "yellow", "info": ""}


def diagnose(
    runs: Annotated[
        list[Path], typer.Argument(metavar="RUN...", help="Run folders or .mcap files of one rig.")
    ],
    rig: Annotated[str, typer.Option("--rig", help="Rig file whose twin is meant, or its name.")],
    reference: Annotated[
        list[Path] | None,
        typer.Option(
            "--reference",
            metavar="RUN0",
            help="A healthy run of the same rig: the answer is what changed since. May be given again.",
        ),
    ] = None,
    effects: Annotated[
        str,
        typer.Option("--effects", help="Weigh only these effects, by the catalogue's names: a,b."),
    ] = "",
    json: JsonFile = None,
    report: Page = None,
    seed: Annotated[int, typer.Option(min=0, help="Of the noise that is drawn.")] = 0,
    propose: Annotated[
        bool,
        typer.Option(
            "--propose/--no-propose",
            help="Where candidates are left, look for the motion that splits them (as `hil gap next`).",
        ),
    ] = True,
) -> None:
    """Name the effect that makes the gap, with parameters, and what it takes off data that no fit has seen.

    Exit status 0 whatever the verdict; 2 where the data cannot be judged.
    """
    outputs = Outputs(json, report)
    outputs.make_ready()
    settings = checked(load_any_rig(rig), rig)
    without = all_but(settings, effects)
    found = diagnose_any(
        [load_run(path, settings) for path in runs],
        settings,
        references=[load_run(path, settings) for path in reference or ()],
        without=without,
        seed=seed,
        report=Steps(),
    )
    if propose and found.verdict == "ambiguous":
        found = with_proposal(found, settings, seed)
    names = [path.name for path in reference or ()]
    outputs.give(
        found.to_json, lambda path: diagnosis_page(found, path, names), lambda: show(found)
    )


def with_proposal(found: Diagnosis, rig: AnyRig, seed: int) -> Diagnosis:
    """The same diagnosis with the experiment that would split its candidates, where one can be found."""
    err.print("looking for a motion that splits what is left")
    try:
        if isinstance(rig, BicycleFile):
            proposal = propose_ride(found.tables(), rig, seed=seed).table()
        else:
            proposal = next_experiment(found.tables(), rig, seed)
    except IdentificationError as error:
        err.print(f"no experiment: {error}", style="yellow", soft_wrap=True)
        return found
    return replace(found, next_experiment=proposal)


def all_but(rig: AnyRig, effects: str) -> tuple[str, ...]:
    """The effects of a rig's model that `effects` (names, commas between) does not list; none if it is
    empty."""
    chosen = {part.strip() for part in effects.split(",") if part.strip()}
    known = effect_names(rig)
    strange = chosen.difference(known)
    if strange:
        raise typer.BadParameter(
            f"{rig.name} has no effect {', '.join(sorted(strange))}; it knows {', '.join(known)}",
            param_hint="--effects",
        )
    return tuple(e for e in known if e not in chosen) if chosen else ()


class Steps:
    """Says each step on stderr, with the time since the start."""

    def __init__(self) -> None:
        self._start_s = time.monotonic()

    def __call__(self, text: str) -> None:
        """The step `text` begins."""
        err.print(f"{time.monotonic() - self._start_s:5.1f} s  {text}", soft_wrap=True)


def show(found: Diagnosis) -> None:
    """The answer as text on stdout."""
    for f in found.located.findings:
        out.print(f"{f.subject}: {f.text}", style=STYLE[f.severity], soft_wrap=True)
    out.print(found.sentence, style="bold", soft_wrap=True)
    listed = [c for c in found.causes if c.probability > SHOWN or c in found.effects]
    if listed:
        out.print(_causes(listed))
        rest = len(found.causes) - len(listed)
        if rest:
            out.print(f"{rest} more were fitted, each less likely than one in a thousand")
    for c in found.effects:
        for name, p in c.parameters.items():
            if p.at_bound:
                out.print(
                    f"alarm: {c.location}.{c.effect}.{name} stands at its bound, "
                    f"{with_unit(f'{p.value:.4g}', p.unit)}",
                    style="yellow", soft_wrap=True,
                )  # fmt: skip
    for line in notes(found):
        out.print(line, soft_wrap=True)


def notes(found: Diagnosis) -> list[str]:
    """What stands beside the table of causes: shrink, classes, what is unknown, what was not excited."""
    s, lines = found.score, []
    if s is not None:
        text = f"held out ({found.held_out}): {s.before:.2f} floors before, {s.after:.2f} after"
        if s.shrink is not None:
            text += f"; shrink {100.0 * s.shrink:.0f} %"
            if s.shrink_ci is not None:
                text += f", 90 % interval {100 * s.shrink_ci[0]:.0f} … {100 * s.shrink_ci[1]:.0f} %"
        lines.append(f"{text}; judged on {some(s.signals)}")
    for group in found.tables()["classes"]:
        if len(group) > 1:
            lines.append(f"these data cannot tell apart: {', '.join(group)}")
    if found.causes:
        lines.append(f"chance that it is none of these: {100.0 * found.unknown:.1f} %")
    if found.not_excited:
        lines.append(f"not excited, so not judged: {some(found.not_excited)}")
    lines.append(f"floor: {found.located.floor_text}")
    return lines


def some(names: Sequence[str]) -> str:
    """Names with commas between, and how many more there are."""
    more = len(names) - LISTED
    return ", ".join(names[:LISTED]) + (f" and {more} more" if more > 0 else "")


def _causes(causes: Sequence[Cause]) -> Table:
    table = Table(
        Column("cause", no_wrap=True), Column("p", justify="right"), Column("class", justify="right"),
        "parameters (90 %)", Column("shrink", justify="right"), Column("gain, nats", justify="right"),
    )  # fmt: skip
    for c in causes:
        values = "\n".join(
            with_unit(f"{name} {p.value:.4g} ({p.ci[0]:.4g} … {p.ci[1]:.4g})", p.unit)
            for name, p in c.parameters.items()
        )
        table.add_row(
            f"{c.location}.{c.effect}", f"{c.probability:.3f}", str(c.group), values,
            "" if c.shrink is None else f"{100.0 * c.shrink:.0f} %", f"{c.gain:.0f}",
        )  # fmt: skip
    return table
