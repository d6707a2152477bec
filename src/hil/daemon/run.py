"""`hil run`: the lock, the bus, the gateway process, and the control process that this one becomes."""

from __future__ import annotations

import asyncio
import contextlib
import subprocess

from hil.bus.port import open_port
from hil.bus.schedule import require_schedule_fits
from hil.config import RigFile
from hil.daemon.control_process import ControlProcess
from hil.daemon.gateway.options import GatewayOptions
from hil.daemon.gateway.process import start_gateway
from hil.daemon.ipc import socket_pair
from hil.daemon.leaving import GATEWAY_END_S
from hil.daemon.lock import RigLock
from hil.daemon.log import Log
from hil.daemon.sdnotify import Notifier
from hil.drives import build_drivers
from hil.drives.profiles import Profiles
from hil.errors import HilError


def run_rig(
    rig: RigFile,
    rig_text: str,
    profiles: Profiles,
    options: GatewayOptions,
    *,
    read_only: bool = False,
) -> int:
    """Run the rig until SIGINT or SIGTERM. Returns 0, or 1 if it did not end in order: the gateway process
    died meanwhile, or the rig's power was cut before it had parked.

    ConfigError where rig file, drive file and bit rate contradict each other, RigInUse where another
    daemon has the rig or the bus, BusError where there is no such bus.
    """
    drives = build_drivers(rig, profiles)
    require_schedule_fits(rig, profiles)
    with contextlib.ExitStack() as stack:
        stack.enter_context(RigLock(rig.name, *rig.can.urls))
        log = Log(rig.name)
        stack.callback(log.close)
        notifier = stack.enter_context(Notifier())
        ports = []
        for url, bitrate in zip(rig.can.urls, rig.can.bitrates, strict=True):
            ports.append(open_port(url, bitrate_bps=bitrate, read_only=read_only))
            stack.callback(ports[-1].close)
        ours, theirs = socket_pair()
        gateway = start_gateway(rig, rig_text, theirs, options)
        stack.callback(_end_gateway, gateway)
        control = ControlProcess(rig, drives, ports, ours, notifier, log)
        asyncio.run(control.run())
    if gateway.returncode == 2:
        raise HilError(f"{rig.name}: the gateway process could not start; its reason is above")
    return 1 if control.gateway_died or control.power_was_cut else 0


def _end_gateway(gateway: subprocess.Popen[bytes]) -> None:
    try:
        gateway.wait(GATEWAY_END_S)
    except subprocess.TimeoutExpired:
        gateway.kill()
        gateway.wait()
