"""`hil cue`: motion cues from a measured ride, from a file, or from the built-in ride, to a running rig."""

from __future__ import annotations

import time
from collections.abc import Iterable
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from hil.cli.client import Endpoint
from hil.cli.console import JsonFlag, RigArgument, err, out, write_json
from hil.client import ENDPOINT, RigClient
from hil.client.stream import need_following, stream
from hil.config import RigFile
from hil.configfile import load_rig
from hil.control.demo_ride import DURATION_S, DemoRide
from hil.control.streaming import cues, motion_of
from hil.control.trajectory import fit
from hil.errors import ConfigError, RunError
from hil.rigs import build_rig
from hil.runs.cuefile import read_cue_file, write_cue_file
from hil.runs.cuelog import cue_from_log
from hil.runs.cuemap import read_cue_map
from hil.signals import Cue

app = typer.Typer(
    help="Motion cues: make them of a measured ride, stream them to a running rig.",
    no_args_is_help=True,
)


def ride_cues(rig: RigFile, seconds: float) -> Iterable[Cue]:
    """The built-in ride of a rig."""
    return cues(DemoRide(rig).poses, 0.0, seconds, "demo-ride")


def file_cues(rig: RigFile, file: Path) -> Iterable[Cue]:
    """The cues of a cue file; ConfigError where it is for another kind of rig or leaves this one's limits.

    The guard would move each pose onto the limits: a file in degrees would swing from one to the other.
    """
    trajectory = read_cue_file(file).trajectory
    if trajectory.coordinates != rig.coordinates:
        raise ConfigError(
            f"{file}: moves {', '.join(trajectory.coordinates)}, but {rig.name} has "
            f"{', '.join(rig.coordinates)}; make it anew with `hil cue from-log ... --rig {rig.name}`"
        )
    for name, limit, way in zip(rig.coordinates, rig.limits, trajectory.poses.T, strict=True):
        furthest = float(way[np.argmax(np.abs(way))])
        if abs(furthest) > limit * (1.0 + 1.0e-6):
            raise ConfigError(
                f"{file}: {name} goes to {furthest:.4g}, the rig {rig.name} to ±{limit:g}: is it in m or "
                "rad? `hil cue from-log` makes a cue file fit"
            )
    t_s = trajectory.t_s
    return cues(motion_of(trajectory), float(t_s[0]), float(t_s[-1]), file.name)


@app.command()
def ride(
    rig: RigArgument,
    endpoint: Endpoint = ENDPOINT,
    seconds: Annotated[
        float, typer.Option(help="How much of the ride.", min=1.0, max=DURATION_S)
    ] = DURATION_S,
) -> None:
    """Stream the built-in minute of riding: lane changes, a curve, braking, accelerating. Then park."""
    settings = load_rig(rig)
    _stream(settings, ride_cues(settings, seconds), endpoint)


@app.command()
def play(
    rig: RigArgument,
    file: Annotated[Path, typer.Argument(help="A cue file: CSV with t and the rig's coordinates.")],
    endpoint: Endpoint = ENDPOINT,
) -> None:
    """Stream a cue file to a running rig, in its own time. Then park."""
    settings = load_rig(rig)
    _stream(settings, file_cues(settings, file), endpoint)


@app.command("from-log")
def from_log(
    log: Annotated[Path, typer.Argument(help="A measured ride: CSV, parquet, also .gz.")],
    cue_map: Annotated[
        str,
        typer.Option(
            "--map",
            help="What becomes what: coordinate=column:unit, then *scale and @low-pass in Hz, as in "
            "'roll=lean_angle:rad*0.5@2, pitch=speed:m/s, t=time:ms'; or a TOML file.",
        ),
    ],
    target: Annotated[Path, typer.Option("--out", "-o", help="The cue file to write.")],
    rig: Annotated[str, typer.Option("--rig", help="The rig that shall ride it.")] = "motorcycle",
    rate_hz: Annotated[
        float | None,
        typer.Option("--rate", help="Sampling rate of a log without times, Hz.", min=0.1),
    ] = None,
    low_pass_hz: Annotated[
        float | None, typer.Option("--low-pass", help="Zero-phase low-pass over all, Hz.", min=0.05)
    ] = None,
    json: JsonFlag = False,
) -> None:
    """Turn a measured ride into a cue file that a rig can ride.

    The unit says what is done: an angle is the pose itself, an acceleration becomes tilt by washout, a speed
    is differentiated first. What would leave the rig's limits is scaled, never clipped, and every change is
    said.
    """
    settings = load_rig(rig)
    if target.exists() and log.exists() and target.samefile(log):
        raise RunError(f"{target}: is the log itself, which the cue file would take the place of")
    imported = cue_from_log(log, read_cue_map(cue_map), settings, rate_hz)
    try:
        fitted = fit(imported.trajectory, settings, build_rig(settings), low_pass_hz)
    except RunError as error:
        raise RunError(f"{log}: {error}; is its time in the unit that the map says?") from error
    notes = (*imported.notes, *fitted.notes)
    write_cue_file(target, fitted.trajectory, settings.name, notes)
    duration_s = fitted.trajectory.duration_s
    if json:
        factors = dict(zip(settings.coordinates, fitted.factors, strict=True))
        write_json(
            {"file": str(target), "duration_s": duration_s, "factors": factors, "notes": notes}
        )
        return
    for note in notes:
        out.print(note, soft_wrap=True)
    out.print(f"{target}: {duration_s:.1f} s for {settings.name}", soft_wrap=True)


def _stream(rig: RigFile, cues_of: Iterable[Cue], endpoint: str) -> None:
    with RigClient(rig.name, endpoint, name="hil-cue") as client:
        need_following(client)
        start_s = time.monotonic()
        reply = stream(client, cues_of, rig.coordinates)
    err.print(f"cues sent for {time.monotonic() - start_s:.1f} s; {reply.message}")
