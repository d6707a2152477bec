"""What else a daemon meets on this PC: another daemon, taken endpoints, a full disk, a model not compiled."""

from __future__ import annotations

import errno
import ipaddress
import os
import shutil
import socket
import time
from pathlib import Path
from typing import Final

from hil.config import RigFile
from hil.daemon.check.finding import Finding
from hil.daemon.core import RigCore
from hil.daemon.lock import RigLock
from hil.drives import build_drivers
from hil.drives.profiles import Profiles
from hil.errors import RigInUse
from hil.rigs import kernel
from hil.runs.folder import nearest
from hil.runs.recorder import RESERVE_BYTES

BYTES_PER_DRIVE_S: Final = 60_000.0
"""What a drive adds to a recording a second: measured on the demo's ride, 0.17 MB/s with three."""
SHORTEST_H: Final = 2.0
"""A disk that holds less than this many hours is worth a warning."""


def check_daemon(rig: RigFile) -> list[Finding]:
    """Whether another daemon has the rig or the bus."""
    try:
        with RigLock(rig.name, *rig.can.urls):
            return [Finding("ok", "daemon", "no other daemon has this rig or bus")]
    except RigInUse as error:
        return [Finding("warn", "daemon", str(error), "stop it to check the drives, or leave it")]


def check_endpoints(rig: RigFile, *, is_running: bool) -> list[Finding]:
    """Whether clients' endpoints are free, and whom they let in."""
    return [f for endpoint in rig.zenoh.listen for f in _endpoint(rig, endpoint, is_running)]


def check_disk(rig: RigFile) -> list[Finding]:
    """Whether recordings can be written, and for how long."""
    folder = Path(rig.recording.folder).absolute()
    there = nearest(folder)
    if not os.access(there, os.W_OK):
        text = f"recordings into {folder} cannot be written: no rights in {there}"
        remedy = "change recording.folder, or the folder's owner"
        return [Finding("fault", "disk", text, remedy)]
    free = shutil.disk_usage(there).free - RESERVE_BYTES
    hours = free / (BYTES_PER_DRIVE_S * len(rig.actuators)) / 3600.0
    if hours <= 0.0:
        text = f"the disk of {folder} is full: nothing will be recorded"
        return [Finding("fault", "disk", text, "make room, or change recording.folder")]
    text = f"{folder} has room for about {hours:.0f} h of recording"
    if hours < SHORTEST_H:
        return [Finding("warn", "disk", text, "make room: `hil runs list` shows what is there")]
    return [Finding("ok", "disk", text)]


def check_model(rig: RigFile, profiles: Profiles) -> list[Finding]:
    """Whether the compiled model is at hand; it is compiled where it is not, which takes a minute."""
    begun_s = time.monotonic()
    RigCore(rig, build_drivers(rig, profiles), 0.0)
    took_s = time.monotonic() - begun_s
    stats = kernel.terms.stats
    if not stats.cache_path:
        text = f"the compiled model cannot be kept: each start takes {took_s:.0f} s more"
        return [Finding("warn", "model", text, "make ~/.cache writable, or set XDG_CACHE_HOME")]
    if stats.cache_misses:
        text = (
            f"the model was compiled just now, in {took_s:.0f} s, and is kept in {stats.cache_path}"
        )
        return [Finding("ok", "model", text)]
    return [Finding("ok", "model", f"the compiled model was loaded within {took_s:.1f} s")]


def _endpoint(rig: RigFile, endpoint: str, is_running: bool) -> list[Finding]:
    protocol, _, place = endpoint.partition("/")
    host, _, port = place.partition("?")[0].rpartition(":")
    if protocol not in ("tcp", "tls") or not port.isdecimal():
        return []
    found = []
    if not is_running:
        found.append(_free(endpoint, host.strip("[]"), int(port)))
    if protocol == "tcp" and rig.zenoh.config is None and not _is_loopback(host.strip("[]")):
        text = f"{endpoint} lets anybody on that network move the rig"
        remedy = "use TLS with client certificates and an access list: docs/zenoh.md"
        found.append(Finding("warn", "endpoint", text, remedy))
    return found


def _free(endpoint: str, host: str, port: int) -> Finding:
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    with socket.socket(family, socket.SOCK_STREAM) as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((host, port))
        except OSError as error:
            if error.errno == errno.EADDRINUSE:
                text = f"the Zenoh endpoint {endpoint} is taken by another program"
                remedy = f"`ss -ltnp 'sport = :{port}'` shows it; stop it, or change zenoh.listen"
            else:
                text = f"the Zenoh endpoint {endpoint} cannot be opened: {error.strerror}"
                remedy = "change zenoh.listen to an address of this PC"
            return Finding("fault", "endpoint", text, remedy)
    return Finding("ok", "endpoint", f"the Zenoh endpoint {endpoint} is free")


def _is_loopback(host: str) -> bool:
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"
