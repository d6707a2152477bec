"""`hil gap next`: the experiment that best splits the candidates that a diagnosis leaves."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.table import Table

from hil.cli.console import err, out, write_json
from hil.cli.gap_answer import read_answer_file
from hil.cli.outputs import make_ready_anew
from hil.config import BicycleFile
from hil.configfile import load_any_rig
from hil.effectlines import checked
from hil.gap.bicycle.next import RideProposal, propose_ride, ride_folders, write_ride_proposal
from hil.gap.next import Proposal, motion_beside, propose, read_candidates, write_proposal


def next_experiment(
    diagnosis: Annotated[
        Path, typer.Argument(metavar="DIAGNOSIS", help="Answer file of `hil gap diagnose`.")
    ],
    rig: Annotated[str, typer.Option("--rig", help="Rig file that was diagnosed, or its name.")],
    to: Annotated[
        Path,
        typer.Option(
            "--out", help="Experiment to write (.toml); its motion goes beside it as .csv."
        ),
    ],
    seconds: Annotated[
        float, typer.Option(min=8.0, max=600.0, help="Length of the motion.")
    ] = 25.0,
    count: Annotated[
        int | None, typer.Option(min=1, help="Motions to draw; default by the rig's size.")
    ] = None,
    payload: Annotated[
        bool, typer.Option(help="Whether a weighed payload may be asked for.")
    ] = True,
    seed: Annotated[int, typer.Option(min=0, help="Of the motions that are drawn.")] = 0,
    as_json: Annotated[bool, typer.Option("--json", help="Write JSON instead of text.")] = False,
) -> None:
    """Find the motion within the rig's limits that best tells the remaining candidates apart.

    For a bicycle it is a manoeuvre of its catalogue: an instruction for the rider, and beside it a simulated
    ride for each candidate, to hold the real one against.
    """
    settings = checked(load_any_rig(rig), rig)
    if isinstance(settings, BicycleFile):
        _ride(diagnosis, settings, rig, to, seed, as_json)
        return
    answer = read_answer_file(diagnosis)
    make_ready_anew(to, motion_beside(to))
    with err.status("drawing motions") as status:
        found = propose(
            answer, settings, seconds=seconds, count=count, payload=payload, seed=seed,
            report=status.update,
        )  # fmt: skip
        write_proposal(to, found)
    if as_json:
        write_json({**found.table(), "file": str(to)})
        return
    _show(found)
    out.print(f"play it: hil experiment {rig} play {to}", soft_wrap=True)
    if found.sketch.payload_kg:
        out.print("and again with the payload bolted on: --weighed", soft_wrap=True)


def _ride(diagnosis: Path, rig: BicycleFile, name: str, to: Path, seed: int, as_json: bool) -> None:
    answer = read_answer_file(diagnosis)
    make_ready_anew(to, *ride_folders(to, read_candidates(answer, rig)[0]))
    with err.status("riding") as status:
        found = propose_ride(answer, rig, seed=seed, report=status.update)
        folders = write_ride_proposal(to, found, seed)
    if as_json:
        simulated = [str(f) for f in folders]
        write_json({**found.table(), "file": str(to), "simulated": simulated})
        return
    _show(found)
    for folder in folders:
        out.print(f"a simulated ride: {folder}", soft_wrap=True)
    if found.split.apart():
        then = f"ride it, then: hil gap diagnose RUN... RIDE --rig {name}"
        out.print(then, soft_wrap=True)


def _show(found: Proposal | RideProposal) -> None:
    names = [c.name for c in found.candidates]
    table = Table("were it", "now", *(f"then {n}" for n in names))
    for k, c in enumerate(found.candidates):
        row = [f"{100.0 * q:.0f} %" for q in found.split.posterior[k]]
        table.add_row(c.name, f"{100.0 * c.probability:.0f} %", *row)
    out.print(table)
    out.print(found.sentence, style="bold", soft_wrap=True)
