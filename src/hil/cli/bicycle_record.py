"""`hil bicycle record`, `nodes`, `press`, `calibrate`: from the sensors to a run and a calibrated file."""

from __future__ import annotations

import asyncio
import contextlib
import math
import time
from collections.abc import Callable
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer
from rich.table import Table

from hil.bicycle.acquisition import Acquisition, Told, acquire
from hil.bicycle.calibration import calibrate
from hil.bicycle.live import LiveState
from hil.bicycle.nodes import frames_of, play
from hil.bicycle.remote import RemoteControl
from hil.bicycle.simulated import simulate_ride
from hil.bus.hub import Hub
from hil.bus.port import BusPort, open_port
from hil.cli.console import err, out
from hil.cli.options import CanOption, RunsOption
from hil.cli.outputs import make_ready_anew
from hil.configfile import load_bicycle, rig_toml, write_rig_file
from hil.drives.bicycle_nodes import Button, encode_button
from hil.runs import load_run

RigName = Annotated[str, typer.Argument(metavar="RIG", help="The bicycle's file, or its name.")]


class ButtonName(StrEnum):
    """The panel's buttons."""

    start = "start"
    stop = "stop"
    calibrate = "calibrate"


def record_command(
    rig: RigName,
    can: CanOption = None,
    runs: RunsOption = None,
    seconds: Annotated[
        float | None, typer.Option(min=0.5, help="Record for so long; default until Ctrl-C.")
    ] = None,
    wait: Annotated[
        bool,
        typer.Option(
            "--wait", help="Wait for the panel's start button, `hil bicycle press`, or a client."
        ),
    ] = False,
    live: Annotated[bool, typer.Option(help="Compute the ride while it is ridden.")] = True,
    remote: Annotated[
        bool | None,
        typer.Option(
            "--zenoh/--no-zenoh",
            help="Take `hil command RIG record on|off` over Zenoh too; default: with --wait.",
        ),
    ] = None,
) -> None:
    """Record rides from the sensor nodes: each start and stop, of the panel or a client, makes a run."""
    bicycle = load_bicycle(rig)
    url = can or bicycle.can.url
    folder = runs or Path(bicycle.recording.folder)
    on_terminal = _teller()
    listeners: list[Callable[[Told], None]] = [on_terminal]

    def tell(told: Told) -> None:
        for listener in listeners:
            listener(told)

    acquisition = Acquisition(bicycle, folder, tell, live=live)

    async def serve(port: BusPort) -> None:
        async with contextlib.AsyncExitStack() as stack:
            if wait if remote is None else remote:
                control = RemoteControl(bicycle, acquisition, time.monotonic)
                stack.callback(control.close)
                control.open()
                listeners.append(control.hear)
                where = ", ".join(bicycle.zenoh.listen) or bicycle.zenoh.config
                err.print(f"hil command {rig} record on, at {where}", soft_wrap=True)
            await acquire(acquisition, port, time.monotonic, seconds, wait=wait)

    port = open_port(url, bitrate_bps=bicycle.can.bitrate)
    try:
        with contextlib.closing(port), contextlib.suppress(KeyboardInterrupt):
            asyncio.run(serve(port))
    finally:  # a bus that goes away in the middle takes no run with it
        for path in acquisition.paths:
            out.print(str(path), soft_wrap=True)


def nodes_command(
    rig: RigName,
    can: CanOption = None,
    run: Annotated[
        Path | None, typer.Option("--run", help="Play this recorded ride; default: simulate one.")
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Of the simulated ride.")] = 0,
    hub: Annotated[
        bool,
        typer.Option("--hub", help="Also be the hub of a hub:SOCKET_PATH bus that nobody serves."),
    ] = False,
) -> None:
    """Be the sensor nodes: play a ride over a bus in real time, from the start button to the stop button."""
    bicycle = load_bicycle(rig)
    table = simulate_ride(bicycle, seed=seed).table if run is None else load_run(run, bicycle).table
    url = can or bicycle.can.url

    async def serve() -> int:
        async with contextlib.AsyncExitStack() as stack:
            if hub:
                if not url.startswith("hub:"):
                    raise typer.BadParameter(f"--hub serves hub:SOCKET_PATH, not {url}")
                path = Path(url.removeprefix("hub:").partition("?")[0])
                await stack.enter_async_context(Hub(path, bicycle.can.bitrate))
                await asyncio.sleep(3.0)  # for whoever waits for the bus to be there
            port = open_port(url, bitrate_bps=bicycle.can.bitrate)
            stack.callback(port.close)
            err.print(f"{bicycle.name}'s nodes speak on {url}", soft_wrap=True)
            unsent = await play(frames_of(bicycle, table), port, time.monotonic)
            await asyncio.sleep(0.2)  # the last frames are still on the wire
            return unsent

    with contextlib.suppress(KeyboardInterrupt):
        unsent = asyncio.run(serve())
        err.print(f"the ride is over; {unsent} frames were not taken by the bus", soft_wrap=True)


def press_command(
    rig: RigName, button: Annotated[ButtonName, typer.Argument()], can: CanOption = None
) -> None:
    """Press a button of the panel from here: start, stop or calibrate a recording that waits."""
    bicycle = load_bicycle(rig)
    url = can or bicycle.can.url
    with contextlib.closing(open_port(url, bitrate_bps=bicycle.can.bitrate)) as port:
        port.send(encode_button(bicycle.sensors.base_id, Button[button.value.upper()]))
        time.sleep(0.05)  # until it is on the wire


def calibrate_command(
    rig: RigName,
    runs: Annotated[
        list[Path], typer.Argument(metavar="RUN...", help="Runs at rest; the first upright.")
    ],
    out_file: Annotated[Path, typer.Option("--out", help="The calibrated rig file to write.")],
) -> None:
    """Set zeros, biases, scales and mounting from static poses, and write the bicycle's file anew."""
    make_ready_anew(out_file)
    bicycle = load_bicycle(rig)
    found = calibrate([load_run(path, bicycle) for path in runs], bicycle)
    table = Table("pose", "lean", "steer", "gravity, m/s²")
    for p in found.poses:
        felt = ", ".join(f"{a:+.3f}" for a in p.accel)
        table.add_row(p.name, f"{p.lean:+.4f} rad", f"{p.steer:+.4f} rad", felt)
    out.print(table)
    s = found.sensors
    axes = Table("axis", "gyroscope bias, rad/s", "bias, m/s²", "scale")
    for k, axis in enumerate("xyz"):
        axes.add_row(
            axis,
            f"{s.gyro_bias[k]:+.5f}",
            f"{s.accel_bias[k]:+.4f} ± {found.accel_sd[k]:.4f}",
            f"{s.accel_scale[k]:.5f} ± {found.accel_sd[3 + k]:.5f}",
        )
    out.print(axes)
    cross = ", ".join(f"{c:+.5f}" for c in s.accel_cross)
    out.print(f"axes off square by {cross} (xy, xz, yz)")
    for note in found.notes:
        style = "yellow" if note.startswith("warning") else ""
        out.print(note, style=style, soft_wrap=True)
    out.print(f"gravity is met within {found.residual:.4f} m/s² over {len(found.poses)} poses")
    write_rig_file(out_file, rig_toml(found.applied(bicycle), s.provenance))
    err.print(f"{out_file} written", soft_wrap=True)


def _teller() -> Callable[[Told], None]:
    """Prints what a person should hear: every sentence, and a state twice a second."""
    shown_s = -math.inf

    def tell(told: Told) -> None:
        nonlocal shown_s
        if told.text:
            err.print(told.text, soft_wrap=True)
        if told.state is not None and told.state.t_s - shown_s >= 0.5:
            shown_s = told.state.t_s
            err.print(_line(told.state), soft_wrap=True)

    return tell


def _line(s: LiveState) -> str:
    pitch = s.imu_off.get("gyro_y")
    up = s.imu_off.get("accel_z")
    beside = ""
    if pitch is not None and up is not None:
        beside = f", IMU off by {pitch:+.3f} rad/s in pitch, {up:+.2f} m/s² upward"
    return (
        f"x {s.x:7.2f} y {s.y:7.2f} m, {s.speed:5.2f} m/s, lean {s.lean:+.3f} steer {s.steer:+.3f} rad, "
        f"drive {s.drive_torque:+6.1f} N·m, steer {s.steer_torque:+5.2f} N·m, "
        f"front {s.normal_front:4.0f} N{beside}"
    )
