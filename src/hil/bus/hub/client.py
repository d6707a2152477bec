"""A port on the hub: a connected AF_UNIX SEQPACKET socket, one record a frame."""

from __future__ import annotations

import itertools
import os
import socket
from pathlib import Path
from typing import Final

from hil.bus.socketport import SEND_BUFFER, SocketPort
from hil.errors import BusError

NAME_PREFIX: Final = b"\0hil-hub/"
"""A client tells its name by the abstract address that it binds, not by a record of its own."""

NAME_BYTES: Final = 40
PATH_BYTES: Final = 107
"""What a Unix socket's address holds, less its closing zero (unix(7))."""

_CONNECT_S: Final = 2.0
_serial = itertools.count()


def require_path_fits(path: Path) -> None:
    """BusError if `path` is too long for a Unix socket."""
    if len(os.fsencode(path)) > PATH_BYTES:
        raise BusError(
            f"hub:{path}: a socket's path has at most {PATH_BYTES} bytes; choose a shorter one, "
            "such as /tmp/hil.sock"
        )


def open_hub(path: Path, *, node: str | None = None, read_only: bool = False) -> SocketPort:
    """A port on the hub that listens at `path`; BusError if there is none.

    `node` is the name by which fault scripts and counters know this client; the hub numbers
    those without one. A read-only port has its sending side shut: the kernel refuses (EPIPE).
    """
    require_path_fits(path)
    url = f"hub:{path}"
    sock = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    try:
        if node is not None:
            sock.bind(_address(url, node))
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SEND_BUFFER)
        sock.settimeout(_CONNECT_S)
        sock.connect(str(path))
        if read_only:
            sock.shutdown(socket.SHUT_WR)
    except OSError as error:
        sock.close()
        raise BusError(
            f"{url}: no hub answers there ({error.strerror or error}); start one with "
            f"`python -m hil.bus.hub {path}`"
        ) from error
    except BaseException:
        sock.close()
        raise
    return SocketPort(
        url,
        sock,
        read_only=read_only,
        remedy=f"start the hub again with `python -m hil.bus.hub {path}` and reconnect",
    )


def _address(url: str, node: str) -> bytes:
    encoded = node.encode()
    if not encoded or len(encoded) > NAME_BYTES or b"/" in encoded:
        raise BusError(f"{url}: a node's name has 1 to {NAME_BYTES} bytes and no '/', not {node!r}")
    return NAME_PREFIX + encoded + b"/%d.%d" % (os.getpid(), next(_serial))
