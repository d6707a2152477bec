"""One daemon a rig and bus: a lock that the kernel gives back however its holder dies.

The lock is the name of an abstract Unix socket: it needs no folder and no rights, it holds between
users, and it lives in the same network namespace as the CAN interface that it protects.
"""

from __future__ import annotations

import errno
import hashlib
import socket
import struct
from pathlib import Path
from types import TracebackType
from typing import Final, Self

from hil.config import bus_of
from hil.errors import RigInUse

_UCRED: Final = struct.Struct("3i")
"""pid, uid, gid as SO_PEERCRED gives them, unix(7)."""


class RigLock:
    """Holds the bus, and the rig's name on it, for this process; RigInUse names who has them.

    The bus is locked by itself because two rigs may not share one: each daemon's gate knows its own
    drives only. The name is locked on real buses; behind hubs, any number of simulated rigs of one
    name may run.
    """

    def __init__(self, rig: str, *bus_urls: str) -> None:
        self._wanted = [f"bus {_one_name(url)}" for url in bus_urls]
        if not all(url.startswith("hub:") for url in bus_urls):
            self._wanted.append(f"rig {rig}")
        self._held: list[socket.socket] = []

    def acquire(self) -> Self:
        """Take what is wanted, all or nothing; RigInUse if another daemon has any of it."""
        try:
            for what in self._wanted:
                self._held.append(_take(what))
        except RigInUse:
            self.release()
            raise
        return self

    def release(self) -> None:
        """Give everything back."""
        while self._held:
            self._held.pop().close()

    def __enter__(self) -> Self:
        return self.acquire()

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        tb: TracebackType | None,
    ) -> None:
        self.release()


def _one_name(url: str) -> str:
    """The bus of a port's `url`, the same however one comes to it: options, a hub's path, the adapter."""
    scheme, target = bus_of(url)
    if scheme == "python-can" and target.startswith("socketcan:"):
        scheme, target = bus_of(target)
    return f"hub:{Path(target).resolve()}" if scheme == "hub" else f"{scheme}:{target}"


def _take(what: str) -> socket.socket:
    digest = hashlib.sha256(what.encode()).hexdigest()[:16]
    address = b"\0hil " + what.encode()[:60] + b" " + digest.encode()  # 108 bytes are the most
    lock = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM | socket.SOCK_CLOEXEC)
    try:
        lock.bind(address)
        lock.listen(1)
    except OSError as error:
        lock.close()
        if error.errno != errno.EADDRINUSE:
            raise
        holder = _holder(address)
        raise RigInUse(
            f"{what} is already run by another daemon"
            + (f", process {holder}" if holder else "")
            + "; stop that one first"
        ) from None
    return lock


def _holder(address: bytes) -> int | None:
    """Process that listens at `address`; None if it went away meanwhile or its queue is full."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as probe:
        probe.setblocking(False)
        try:
            probe.connect(address)
            raw = probe.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, _UCRED.size)
        except OSError:
            return None
    pid: int = _UCRED.unpack(raw)[0]
    return pid
