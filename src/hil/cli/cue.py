"""`hil cue`: send motion cues to a running rig."""

from __future__ import annotations

import time
from typing import Annotated

import typer

from hil.cli.client import Endpoint
from hil.cli.console import RigArgument, err
from hil.client import ENDPOINT, RigClient
from hil.configfile import load_rig
from hil.control.demo_ride import DURATION_S, DemoRide

app = typer.Typer(help="Motion cues: stream them to a running rig.", no_args_is_help=True)

CUE_HZ = 50.0
LOOK_AHEAD_S = 0.06
"""A driving simulator that knows its vehicle's next frames sends them along: less lag, no guessing."""


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
    course = DemoRide(settings)
    offsets_s = (0.0, 0.5 * LOOK_AHEAD_S, LOOK_AHEAD_S)
    with RigClient(settings.name, endpoint, name="demo-ride") as client:
        start_s = time.monotonic()
        count = round(seconds * CUE_HZ)
        for k in range(count):
            at_s = k / CUE_HZ
            time.sleep(max(0.0, start_s + at_s - time.monotonic()))
            poses = [
                {"dt": dt, **dict(zip(settings.coordinates, course.pose(at_s + dt), strict=True))}
                for dt in offsets_s
            ]
            client.cues(poses, start_s + at_s)
        reply = client.command("park")
    err.print(f"{count} cues sent in {seconds:g} s; {reply.message}")
