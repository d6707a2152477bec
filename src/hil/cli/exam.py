"""`hil gap exam`: a blind check of the diagnosis. Make sealed cases, sit them, mark them."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Annotated

import typer

from hil.cli.console import err
from hil.exam import Order, make_exam
from hil.exam.make import KINDS
from hil.exam.rigs import RIGS

app = typer.Typer(
    help="A blind check: does the diagnosis find what it cannot know?\n\n"
    "`make` draws cases on a simulated world that is not the twin and seals the answers; `sit` diagnoses "
    "each case from its run folders alone; `mark` opens the seals. Cases of other people sit the same way.",
    no_args_is_help=True,
)


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
        str, typer.Option("--rigs", help="Rigs, taken in turn: axis,motorcycle,stewart.")
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
    order = Order(_list(rigs), seed, severities, _list(kinds), _list(effects))
    show = Progress(cases)
    make_exam(order, cases, out, jobs=jobs, on_done=show.done)


class Progress:
    """A line for each case, with the time that is left."""

    def __init__(self, total: int) -> None:
        self._total, self._count, self._start_s = total, 0, time.monotonic()

    def done(self, case: str, text: str) -> None:
        """Case `case` is finished."""
        self._count += 1
        took_s = time.monotonic() - self._start_s
        left_s = took_s / self._count * (self._total - self._count)
        err.print(
            f"{self._count}/{self._total} {case}: {text}; about {_minutes(left_s)} left",
            markup=False, soft_wrap=True,
        )  # fmt: skip


def _minutes(seconds: float) -> str:
    return f"{seconds:.0f} s" if seconds < 90.0 else f"{seconds / 60.0:.0f} min"


def _list(text: str) -> tuple[str, ...]:
    return tuple(part.strip() for part in text.split(",") if part.strip())
