"""Ports on every interface that python-can drives, through two threads and a socket pair.

python-can blocks, the loop must not: one thread reads the interface and writes records, another
reads records and sends them. The loop sees the same descriptor as on SocketCAN or the hub.
"""

from __future__ import annotations

import contextlib
import math
import socket
import threading
import time
from typing import Any, Final

import can

from hil.bus.socketport import SEND_BUFFER, SocketPort
from hil.errors import BusError, ProtocolError
from hil.frames import FRAME_BYTES, Frame, pack, unpack

_POLL_S: Final = 0.1
"""How long the reader waits for a frame before it looks whether the port was closed."""

_SEND_S: Final = 1.0
"""How long the writer waits for the interface to take a frame before it gives the bus up."""


class PythonCanPort(SocketPort):
    """A `BusPort` on an opened python-can bus, which it owns from here on."""

    def __init__(self, name: str, bus: can.BusABC, *, read_only: bool) -> None:
        outer, self._inner = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        super().__init__(
            name, outer, read_only=read_only, remedy="check adapter and driver, then reopen"
        )
        outer.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SEND_BUFFER)
        self._bus = bus
        self._cause: str | None = None
        self._closing = threading.Event()
        self._until_s = math.inf
        self._threads = [threading.Thread(target=self._read, name=f"{name} reader", daemon=True)]
        if read_only:
            outer.shutdown(socket.SHUT_WR)
        else:
            self._threads.append(
                threading.Thread(target=self._write, name=f"{name} writer", daemon=True)
            )
        for thread in self._threads:
            thread.start()

    def close(self) -> None:
        """Send what waits if that takes no long, stop both threads, shut the interface down."""
        if self._closing.is_set():
            return
        self._until_s = time.monotonic() + _SEND_S
        self._closing.set()
        self._give_up()
        for thread in self._threads:
            thread.join()
        self._inner.close()
        super().close()
        self._bus.shutdown()

    def _lost(self, reason: str) -> BusError:
        return super()._lost(self._cause or reason)

    def _read(self) -> None:
        try:
            while not self._closing.is_set():
                message = self._bus.recv(_POLL_S)
                if message is not None:
                    self._inner.send(_record(message))
        except (can.CanError, OSError) as error:
            self._cause = f"{type(error).__name__}: {error}"
        finally:
            self._give_up()

    def _write(self) -> None:
        try:
            while (record := self._inner.recv(FRAME_BYTES)) and time.monotonic() < self._until_s:
                self._bus.send(_message(unpack(record)), timeout=_SEND_S)
        except (can.CanError, OSError) as error:
            self._cause = f"{type(error).__name__}: {error}"
        finally:
            self._give_up()

    def _give_up(self) -> None:
        """Let the loop see the end of the bus: a port with one thread left must not seem well."""
        with contextlib.suppress(OSError):
            self._inner.shutdown(socket.SHUT_RDWR)


def open_python_can(
    interface: str, channel: str, *, bitrate_bps: int, read_only: bool = False
) -> PythonCanPort:
    """A port on python-can's `interface` and `channel`; BusError says why it cannot be opened."""
    name = f"python-can:{interface}:{channel}"
    options: dict[str, Any] = {"bitrate": bitrate_bps}
    try:
        bus = can.Bus(interface=interface, channel=channel or None, **options)
    except (can.CanError, OSError, ImportError, ValueError, TypeError) as error:
        raise BusError(
            f"{name}: python-can cannot open it ({error}); see `python -m can.logger --help` for "
            "its interfaces, and whether the adapter's driver is installed"
        ) from error
    return PythonCanPort(name, bus, read_only=read_only)


def _record(message: can.Message) -> bytes:
    """The record of what python-can received; one byte too many for what is no classic frame."""
    frame = Frame(
        message.arbitration_id,
        bytes(min(message.dlc, 8)) if message.is_remote_frame else bytes(message.data),
        message.is_extended_id,
        message.is_remote_frame,
        message.is_error_frame,
    )
    try:
        return bytes(FRAME_BYTES + 1) if message.is_fd else pack(frame)
    except ProtocolError:
        return bytes(FRAME_BYTES + 1)


def _message(frame: Frame) -> can.Message:
    return can.Message(
        arbitration_id=frame.can_id,
        data=None if frame.is_remote else frame.data,
        dlc=len(frame.data),
        is_extended_id=frame.is_extended,
        is_remote_frame=frame.is_remote,
    )
