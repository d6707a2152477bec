"""`hil gap exam`: a blind check of the diagnosis. Make sealed cases, sit them, mark them."""

from __future__ import annotations

import json as js
import time
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer
from rich.box import SIMPLE_HEAD
from rich.table import Table

from hil.cli.console import err, out
from hil.cli.outputs import make_ready
from hil.errors import RunError
from hil.exam import Marked, Order, Sitting, make_exam, mark_exam, sit_exam
from hil.exam.mark import Group
from hil.exam.marks import Mark
from hil.exam.order import KINDS
from hil.exam.rigs import RIGS
from hil.exam.sit import LIMIT_S

app = typer.Typer(
    help="A blind check: does the diagnosis find what it cannot know?\n\n"
    "`make` draws cases on a simulated world that is not the twin and seals the answers; `sit` diagnoses "
    "each case from its run folders alone; `mark` opens the seals. Cases of other people sit the same way.",
    no_args_is_help=True,
)


class Mode(StrEnum):
    """What drives are told."""

    position = "position"
    force = "force"


@app.callback()
def group() -> None:
    """The blind check."""


@app.command()
def make(
    out: Annotated[Path, typer.Option("--out", help="Folder for cases/ and answers/.")],
    cases: Annotated[int, typer.Option("--cases", min=1, help="How many.")] = 30,
    seed: Annotated[
        int,
        typer.Option(
            "--seed", min=0, help="Of everything. 1-999: exams; from 1000 on: for tuning."
        ),
    ] = 1000,
    rigs: Annotated[
        str,
        typer.Option("--rigs", help="Rigs, taken in turn: axis,motorcycle,stewart; or bicycle."),
    ] = ",".join(RIGS),
    severity: Annotated[
        str,
        typer.Option(
            "--severity", help="Traces of the effects over the floor, one drawn for each case."
        ),
    ] = "1,3,10",
    kinds: Annotated[
        str, typer.Option("--kinds", help="What cases may hold: none,single,double,triple,outside.")
    ] = ",".join(KINDS),
    effects: Annotated[
        str, typer.Option("--effects", help="Only these effects, by the catalogue's names.")
    ] = "",
    mode: Annotated[
        Mode,
        typer.Option(
            "--mode",
            help="What drives are told: positions, or forces by a loop outside them (computed torque).",
        ),
    ] = Mode.position,
    scatter: Annotated[
        float,
        typer.Option(
            "--scatter", help="How much further than usual healthy rigs are off their files."
        ),
    ] = 1.0,
    jobs: Annotated[int, typer.Option("--jobs", min=1, help="Processes.")] = 2,
) -> None:
    """Draw cases, record them on the exam's own world, seal the answers.

    Cases that are there already stay, so an interrupted exam goes on where it stopped.
    """
    try:
        severities = tuple(float(s) for s in _list(severity))
    except ValueError:
        raise typer.BadParameter(
            f"{severity!r} is no list of numbers", param_hint="--severity"
        ) from None
    make_ready(out / "CASE")
    order = Order(_list(rigs), seed, severities, _list(kinds), _list(effects), mode.value, scatter)
    show = Progress(cases)
    make_exam(order, cases, out, jobs=jobs, on_done=show.done)


class Baseline(StrEnum):
    """Who sits instead of the diagnosis."""

    random = "random"
    best_training = "best-training"
    naive_bic = "naive-bic"
    oracle = "oracle"


@app.command()
def sit(
    cases: Annotated[Path, typer.Argument(help="Folder of cases (or one with cases/ in it).")],
    to: Annotated[Path, typer.Option("--out", help="Folder for the diagnoses, one file a case.")],
    only: Annotated[
        str, typer.Option("--only", help="Only cases whose name matches this pattern (regex).")
    ] = "",
    baseline: Annotated[
        Baseline | None,
        typer.Option(
            "--baseline",
            help="Let a baseline sit instead: random; best-training, the effect with the smallest training "
            "error; naive-bic; oracle, which is told the effect and fits it.",
        ),
    ] = None,
    without: Annotated[
        str,
        typer.Option(
            "--without",
            help="Effects that the diagnosis must not know, by name; auto: withhold from each case the very "
            "effect it has (needs --answers).",
        ),
    ] = "",
    answers: Annotated[
        Path | None,
        typer.Option(
            "--answers", help="For the oracle and --without auto; default: answers/ beside cases/."
        ),
    ] = None,
    limit: Annotated[
        float, typer.Option("--limit", min=1.0, help="Longest time for a case, s.")
    ] = LIMIT_S,
    jobs: Annotated[int, typer.Option("--jobs", min=1, help="Processes.")] = 2,
) -> None:
    """Diagnose each case from its run folders and its rig.toml alone.

    Cases that have a diagnosis in --out are left alone: interrupt and go on as you like, delete a file to sit
    its case again. One folder is for one sitter: another baseline, or other effects withheld, go to another.
    A case that fails gets a diagnosis with the verdict "error".
    """
    make_ready(to / "CASE.json")
    knows = baseline is Baseline.oracle or without == "auto"
    if knows and answers is None:
        beside = [cases / "answers", cases.parent / "answers"]
        answers = next((p for p in beside if p.is_dir()), None)
    sitting = Sitting(
        to,
        baseline.value if baseline else None,
        answers if knows else None,
        "auto" if without == "auto" else _list(without),
        limit,
    )
    show = Progress(0)

    def expect(todo: int, there: int) -> None:
        show.expect(todo)
        if there:
            err.print(f"{there} of {todo + there} have a diagnosis in {to} already", soft_wrap=True)

    sit_exam(cases, sitting, only=only, jobs=jobs, on_done=show.done, on_count=expect)


@app.command()
def mark(
    diagnoses: Annotated[Path, typer.Argument(help="Folder of diagnoses, <case>.json.")],
    answers: Annotated[
        Path, typer.Option("--answers", help="Folder of answers, <case>/answer.json.")
    ],
    json: Annotated[
        Path | None, typer.Option("--json", help="Write every mark, table and wrong case as JSON.")
    ] = None,
    cases: Annotated[
        Path | None,
        typer.Option("--cases", help="Where the seals are; default: cases/ beside the answers."),
    ] = None,
    oracle: Annotated[
        Path | None,
        typer.Option(
            "--oracle", help="Diagnoses by `sit --baseline oracle`, to compare shrink with."
        ),
    ] = None,
    known: Annotated[
        Path | None,
        typer.Option(
            "--known",
            help="For what was sat `--without auto`: diagnoses that knew all effects. They say which of "
            "them nothing in these data tells apart.",
        ),
    ] = None,
    only: Annotated[
        str, typer.Option("--only", help="Only cases whose name matches this pattern (regex).")
    ] = "",
) -> None:
    """Check the seals, open the answers, mark the diagnoses.

    Every answer counts: a missing or broken diagnosis is a wrong one. Marks come with 95 % intervals, for all
    cases from 3 times the floor on, by rig, and by severity.
    """
    make_ready(json)
    marked = mark_exam(diagnoses, answers, cases=cases, oracle=oracle, known=known, only=only)
    if json is not None:
        try:
            json.write_text(js.dumps(marked.tables(), indent=1, ensure_ascii=False) + "\n", "utf-8")
        except OSError as error:
            raise RunError(f"{json}: cannot be written: {error.strerror}") from error
    _show(marked)


def _show(marked: Marked) -> None:
    for group in marked.groups:
        out.print(_table(group))
    for row, columns in marked.tables()["confusion"].items():
        wrong = {c: n for c, n in columns.items() if c != row}
        if wrong:
            text = ", ".join(f"{c} {n}" for c, n in wrong.items())
            out.print(
                f"{row} ({sum(columns.values())}) was also called: {text}",
                soft_wrap=True,
            )
    for case, what in marked.unusable:
        out.print(f"{case}: {what}", style="yellow", soft_wrap=True)
    if marked.unanswered:
        names = ", ".join(marked.unanswered)
        out.print(f"no answer, so no mark: {names}", style="yellow", soft_wrap=True)
    if marked.unsealed:
        count = len(marked.unsealed)
        out.print(f"{count} cases carry no seal that could be checked", style="yellow")


def _table(group: Group) -> Table:
    table = Table(
        "mark", "value", "95 %", "of", "asked", "",
        title=f"{group.name}: {group.papers} cases", title_justify="left", box=SIMPLE_HEAD,
        pad_edge=False, collapse_padding=True,
    )  # fmt: skip
    for k, column in enumerate(table.columns):
        column.no_wrap = True
        column.justify = "left" if k == 0 else "right"
    for m, v in group.marks:
        if v.value is None:
            continue
        reached = m.is_reached(v)
        interval = (
            "" if v.low is None or v.high is None else f"{_bare(v.low, m)}–{_bare(v.high, m)}"
        )
        table.add_row(
            m.name,
            f"{_bare(v.value, m)} {m.unit}".rstrip(),
            interval,
            str(v.count),
            _asked(m),
            "" if reached is None else ("yes" if reached else "no"),
            style="yellow" if reached is False else None,
        )
    return table


def _bare(value: float, m: Mark) -> str:
    return f"{100.0 * value:.1f}" if m.unit == "%" else f"{value:.3g}"


def _asked(m: Mark) -> str:
    if m.least is not None and m.most is not None:
        return f"{_bare(m.least, m)}–{_bare(m.most, m)}"
    if m.least is not None:
        return f"≥ {_bare(m.least, m)}"
    return "" if m.most is None else f"≤ {_bare(m.most, m)}"


class Progress:
    """A line for each case, with the time that is left."""

    def __init__(self, total: int) -> None:
        self._total, self._count, self._start_s = total, 0, time.monotonic()

    def expect(self, total: int) -> None:
        """So many are to come."""
        self._total = total

    def done(self, case: str, text: str) -> None:
        """Case `case` is finished."""
        self._count += 1
        took_s = time.monotonic() - self._start_s
        left_s = took_s / self._count * (self._total - self._count)
        err.print(
            f"{self._count}/{self._total} {case}: {text}; about {_minutes(left_s)} left", soft_wrap=True,
        )  # fmt: skip


def _minutes(seconds: float) -> str:
    return f"{seconds:.0f} s" if seconds < 90.0 else f"{seconds / 60.0:.0f} min"


def _list(text: str) -> tuple[str, ...]:
    return tuple(part.strip() for part in text.split(",") if part.strip())
