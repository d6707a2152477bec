"""`python -m hil.bus.hub PATH`: a simulated CAN bus on a Unix socket, until Ctrl-C or SIGTERM."""

from __future__ import annotations

import argparse
import asyncio
import logging
import signal
import sys
import time
from pathlib import Path

from hil.bus.faults import load_faults
from hil.bus.hub.server import Hub
from hil.errors import HilError

_log = logging.getLogger("hil.bus.hub")


def main(arguments: list[str] | None = None) -> int:
    """Run a hub; the exit code is 0 after a signal and 1 if it could not start."""
    parser = argparse.ArgumentParser(
        prog="python -m hil.bus.hub",
        description="A simulated CAN bus. Programs join it by the URL hub:PATH, or by "
        "hub:PATH?node=NAME to be known by a name.",
    )
    parser.add_argument("path", type=Path, help="the socket to listen at")
    parser.add_argument("--bitrate", type=int, default=500_000, help="bit/s (%(default)s)")
    parser.add_argument("--faults", type=Path, help="TOML file of scripted faults")
    parser.add_argument("--seed", type=int, default=0, help="of random faults (%(default)s)")
    options = parser.parse_args(arguments)
    logging.basicConfig(level=logging.INFO, format="%(message)s", stream=sys.stderr)
    try:
        if not 10_000 <= options.bitrate <= 1_000_000:
            parser.error(f"--bitrate must lie in 10000..1000000 bit/s, not {options.bitrate}")
        faults = load_faults(options.faults) if options.faults else ()
        asyncio.run(_serve(Hub(options.path, options.bitrate, faults=faults, seed=options.seed)))
    except HilError as error:
        _log.error("%s", error)
        return 1
    return 0


async def _serve(hub: Hub) -> None:
    stop = asyncio.Event()
    loop = asyncio.get_running_loop()
    for number in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(number, stop.set)
    started_s = time.monotonic()
    async with hub:
        _log.info("hub:%s carries %d bit/s", hub.path, hub.bus.bitrate_bps)
        await stop.wait()
        totals = hub.totals
    load = totals.busy_s / max(time.monotonic() - started_s, 1e-9)
    _log.info("%d frames, bus load %.1f %%, %d refused", totals.frames, 100 * load, totals.refused)


if __name__ == "__main__":
    raise SystemExit(main())
