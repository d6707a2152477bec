"""`hil run` and `hil simulate`: the daemon of a rig, and the rig that is not there."""

from __future__ import annotations

import asyncio
import contextlib
import os
from pathlib import Path
from typing import Annotated

import typer

from hil.bus.hub import Hub
from hil.bus.port import open_port
from hil.cli.console import RigArgument, complain, err
from hil.cli.options import (
    CanOption,
    ListenOption,
    ModeOption,
    RunsOption,
    SeedOption,
    profiles_of,
    rig_with,
)
from hil.config import RigFile
from hil.daemon.gateway.options import GatewayOptions
from hil.daemon.realtime import PRIORITY, request_fifo
from hil.daemon.run import run_rig
from hil.errors import ConfigError
from hil.sim.rig import SimulatedRig
from hil.sim.serve import serve_until_signalled


def run(
    rig: RigArgument,
    can: CanOption = None,
    mode: ModeOption = None,
    listen: ListenOption = None,
    runs: RunsOption = None,
    record: Annotated[
        bool, typer.Option(help="Record from the start; `hil command RIG record` switches it.")
    ] = True,
    metrics_port: Annotated[
        int | None, typer.Option(help="Serve Prometheus metrics on this loopback port.")
    ] = None,
    read_only: Annotated[
        bool,
        typer.Option("--read-only", help="Listen and record only: nothing can be transmitted."),
    ] = False,
) -> None:
    """Run a rig: the daemon, both processes, until Ctrl-C or SIGTERM, which park the rig first.

    Exit code 78 where rig or drive file is wrong: hild.service does not try again then.

    Comes up disarmed. `hil command RIG arm` arms it, a cue client moves it, `hil watch RIG` shows it.
    """
    options = GatewayOptions(is_recording=record, runs_folder=runs, metrics_port=metrics_port)
    try:
        settings, text = rig_with(rig, can=can, mode=mode, listen=listen, runs=runs)
        code = run_rig(settings, text, profiles_of(settings, rig), options, read_only=read_only)
    except ConfigError as error:
        complain(str(error))
        raise typer.Exit(os.EX_CONFIG) from error
    if code:
        raise typer.Exit(code)


def simulate(
    rig: RigArgument,
    can: CanOption = None,
    seed: SeedOption = 0,
    hub: Annotated[
        bool,
        typer.Option("--hub", help="Also be the hub of a hub:SOCKET_PATH bus that nobody serves."),
    ] = False,
) -> None:
    """Be the rig: plant, drives and IMU answer on a bus as the real ones would, until Ctrl-C.

    Two terminals make a rig on a desk: `hil simulate motorcycle --hub --can hub:/tmp/rig.sock` and
    `hil run motorcycle --can hub:/tmp/rig.sock`.
    """
    settings, _ = rig_with(rig, can=can)
    simulated = SimulatedRig(settings, profiles_of(settings, rig), seed)
    with contextlib.suppress(KeyboardInterrupt):
        asyncio.run(_simulate(settings, simulated, hub=hub))


async def _simulate(rig: RigFile, simulated: SimulatedRig, *, hub: bool) -> None:
    async with contextlib.AsyncExitStack() as stack:
        ports = []
        for url, bitrate in zip(rig.can.urls, rig.can.bitrates, strict=True):
            if hub:
                if not url.startswith("hub:"):
                    raise typer.BadParameter(f"--hub serves hub:SOCKET_PATH, not {url}")
                path = Path(url.removeprefix("hub:").partition("?")[0])
                await stack.enter_async_context(Hub(path, bitrate))
            named = f"{url}?node=rig" if url.startswith("hub:") else url
            ports.append(open_port(named, bitrate_bps=bitrate))
            stack.callback(ports[-1].close)
        request_fifo(PRIORITY - 10)  # below control; a rig that answers late would be a broken one
        err.print(f"{rig.name} is simulated on {', '.join(rig.can.urls)}", soft_wrap=True)
        await serve_until_signalled(simulated, *ports)
