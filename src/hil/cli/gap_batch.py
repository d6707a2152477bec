"""`hil gap batch`: many diagnoses, in local processes or on a cluster."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.table import Column, Table

from hil.cli.console import err, out
from hil.cli.exam import Progress
from hil.cli.gap_diagnose import all_but
from hil.configfile import load_any_rig
from hil.effectlines import checked
from hil.gap.batch import find_jobs, open_jobs, run_jobs, summary


def batch(
    places: Annotated[
        list[Path],
        typer.Argument(
            metavar="RUN|FOLDER...",
            help="Each run is one diagnosis; each folder of runs is one too, of all its runs together.",
        ),
    ],
    rig: Annotated[
        str,
        typer.Option(
            "--rig",
            help="Rig file, or its name; a folder with a rig.toml of its own is judged by that.",
        ),
    ],
    to: Annotated[
        Path, typer.Option("--out", help="Folder for the answers, one file a diagnosis.")
    ],
    jobs: Annotated[int, typer.Option("--jobs", min=1, help="Local processes.")] = 2,
    scheduler: Annotated[
        str | None,
        typer.Option(
            "--scheduler",
            help="A dask.distributed scheduler, tcp://HOST:PORT, instead of local processes. Its workers "
            "must see the same files.",
        ),
    ] = None,
    reference: Annotated[
        list[Path] | None,
        typer.Option(
            "--reference", metavar="RUN0", help="A healthy run for all; may be given again."
        ),
    ] = None,
    effects: Annotated[
        str,
        typer.Option("--effects", help="Weigh only these effects, by the catalogue's names: a,b."),
    ] = "",
    seed: Annotated[int, typer.Option(min=0, help="Of the noise that is drawn.")] = 0,
) -> None:
    """Diagnose many runs. Interrupt and start again as you like: what is finished is not done again.

    An answer that is there counts only for the rig file, runs, references, effects and seed that it was made
    of; where one of them changed, that job is done anew, and it is said so. Exit status 0 where every job has
    a verdict, 1 where one or more failed (the table says which and why; the next start tries them again), 2
    where nothing could be begun.
    """
    work = find_jobs(
        places,
        rig,
        to,
        references=reference or (),
        without=all_but(checked(load_any_rig(rig), rig), effects),
        seed=seed,
    )
    todo = open_jobs(work)
    if len(todo) < len(work):
        err.print(f"{len(work) - len(todo)} of {len(work)} are finished already")
    for job, why in todo.items():
        if why:
            err.print(f"{job.name}: done anew: {why}", soft_wrap=True)
    failed = run_jobs(list(todo), Progress(len(todo)).done, workers=jobs, scheduler=scheduler)
    table = Table(
        Column("runs", no_wrap=True), "verdict", "effects", Column("p", justify="right"),
        Column("shrink", justify="right"),
    )  # fmt: skip
    for row in summary(work):
        p, shrink = row["probability"], row["shrink"]
        table.add_row(
            row["name"], row["verdict"], row["effects"], "" if p is None else f"{p:.3f}",
            "" if shrink is None else f"{100.0 * shrink:.0f} %",
        )  # fmt: skip
    out.print(table)
    if failed:
        err.print(f"{failed} of {len(work)} failed", style="red")
        raise typer.Exit(1)
