"""The hub's server: takes records from its clients, runs `BitBus` against the clock, fans out.

No tasks, only callbacks of the running loop: one for the listener, one a client, one for the
timer. A client that vanishes, stalls or writes nonsense costs itself its connection, its frames
or a count, and the others nothing.
"""

from __future__ import annotations

import asyncio
import contextlib
import math
import os
import select
import socket
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Final, Self

import numpy as np

from hil.bus.bitbus import QUEUE_FRAMES, BitBus, BusTotals
from hil.bus.clocks import STAMP_ROOM, monotonic_minus_realtime_s, received_s, request_stamps
from hil.bus.faults import Fault
from hil.bus.hub.client import NAME_PREFIX, require_path_fits
from hil.bus.state import ERR_BUS_OFF, controller_error
from hil.bus.timerfd import Timer
from hil.errors import BusError, BusOff, ProtocolError
from hil.frames import FRAME_BYTES, Frame, pack, unpack

_TURN_RECORDS: Final = 64
"""Records read from a client before the others have their turn."""


_CLIENTS: Final = 64
"""Clients at a time; a program that connects without end is turned away at the door."""


@dataclass(slots=True)
class ClientCounters:
    """What passed between the hub and one client."""

    received: int = 0
    """Frames taken from the client."""
    malformed: int = 0
    """Records of the client that were no classic data or remote frame."""
    refused: int = 0
    """Frames of the client that came while it was off the bus."""
    delivered: int = 0
    """Frames handed to the client."""
    lost: int = 0
    """Frames that the client was too slow to take."""


@dataclass(slots=True, eq=False)
class _Client:
    name: str
    socket: socket.socket
    counters: ClientCounters
    waits_for_room: bool = False
    listens_only: bool = False


class Hub:
    """A simulated bus of `bitrate_bps` bit/s on a socket at `path`; use with `async with`.

    The bus' clock, by which `faults` are timed, starts at zero when the hub does.
    """

    def __init__(
        self,
        path: Path,
        bitrate_bps: int,
        *,
        faults: Sequence[Fault] = (),
        seed: int = 0,
        queue_frames: int = QUEUE_FRAMES,
    ) -> None:
        self.path = path
        self.bus = BitBus(
            bitrate_bps, np.random.default_rng(seed), faults, queue_frames=queue_frames
        )
        self._clients: dict[str, _Client] = {}
        self._serial = 0
        self._loop: asyncio.AbstractEventLoop | None = None

    async def start(self) -> None:
        """Listen at the path; BusError if another hub does, or if no socket can be put there."""
        require_path_fits(self.path)
        self._listener = _listen(self.path)
        self._inode = self.path.stat().st_ino
        self._start_s = time.monotonic()
        self._armed_s = math.inf
        self._timer = Timer()
        self._loop = asyncio.get_running_loop()
        self._loop.add_reader(self._listener, self._pump)
        self._loop.add_reader(self._timer, self._expired)
        self._pump()

    def close(self) -> None:
        """Disconnect everybody and take the socket away; closing twice is no error."""
        if self._loop is None:
            return
        for client in list(self._clients.values()):
            self._disconnect(client)
        self._loop.remove_reader(self._listener)
        self._loop.remove_reader(self._timer)
        self._loop = None
        self._listener.close()
        self._timer.close()
        with contextlib.suppress(FileNotFoundError):
            if self.path.stat().st_ino == self._inode:  # not what somebody else put there since
                self.path.unlink()

    async def __aenter__(self) -> Self:
        await self.start()
        return self

    async def __aexit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    @property
    def totals(self) -> BusTotals:
        """What the bus has carried since the start; its growth is the load."""
        return self.bus.totals

    @property
    def clients(self) -> dict[str, ClientCounters]:
        """Counters of the clients that are connected, by name."""
        return {name: client.counters for name, client in self._clients.items()}

    @property
    def running(self) -> asyncio.AbstractEventLoop:
        """The loop it runs in; BusError before the start and after the end."""
        if self._loop is None:
            raise BusError(f"hub:{self.path}: the hub is not running")
        return self._loop

    def _now_s(self) -> float:
        return time.monotonic() - self._start_s

    def _accept(self) -> None:
        while True:
            try:
                sock, address = self._listener.accept()
            except OSError:  # nobody waits any more
                return
            if len(self._clients) < _CLIENTS:
                self._welcome(sock, address)
            else:
                sock.close()

    def _welcome(self, sock: socket.socket, address: bytes | str) -> None:
        sock.setblocking(False)
        request_stamps(sock)
        client = _Client(self._free_name(address), sock, ClientCounters())
        self._clients[client.name] = client
        self.bus.attach(client.name)
        self.running.add_reader(sock, self._readable, client)
        if self.bus.is_off(client.name, self._now_s()):
            self._hand(client, controller_error(ERR_BUS_OFF))

    def _free_name(self, address: bytes | str) -> str:
        """The name that the client gave itself by its address, or a number, not yet taken."""
        self._serial += 1
        wished = ""
        if isinstance(address, bytes) and address.startswith(NAME_PREFIX):
            wished = address.removeprefix(NAME_PREFIX).partition(b"/")[0].decode(errors="replace")
        name = wished or f"client-{self._serial}"
        return name if name not in self._clients else f"{name}-{self._serial}"

    def _readable(self, client: _Client) -> None:
        offset_s, now_s = monotonic_minus_realtime_s(), time.monotonic()
        for _ in range(_TURN_RECORDS):
            if self.bus.room(client.name) == 0:
                # Unread records fill the socket's buffer, and then the client's send says EAGAIN.
                client.waits_for_room = True
                self.running.remove_reader(client.socket)
                break
            try:
                record, ancillary, _, _ = client.socket.recvmsg(FRAME_BYTES + 1, STAMP_ROOM)
            except BlockingIOError:
                break
            except ConnectionResetError:  # it closed with frames unread; what it sent still comes
                continue
            except OSError:
                self._disconnect(client)
                break
            if not record and not ancillary:
                self._writes_no_more(client)
                break
            self._take(client, record, received_s(ancillary, offset_s, now_s) - self._start_s)
        self._pump()

    def _take(self, client: _Client, record: bytes, t_s: float) -> None:
        try:
            frame = unpack(record)
            if frame.is_error:
                raise ProtocolError("a client's error frame has no place on the bus")
        except ProtocolError:
            client.counters.malformed += 1
            return
        try:
            self.bus.submit(client.name, frame, t_s)
            client.counters.received += 1
        except BusOff:
            client.counters.refused += 1

    def _writes_no_more(self, client: _Client) -> None:
        """The client has gone, or it is a read-only one that has shut its sending side."""
        poll = select.poll()
        poll.register(client.socket, 0)
        if any(event & select.POLLHUP for _, event in poll.poll(0)):
            self._disconnect(client)
        else:
            client.listens_only = True
            self.running.remove_reader(client.socket)

    def _disconnect(self, client: _Client) -> None:
        if self._clients.pop(client.name, None) is None:
            return
        self.running.remove_reader(client.socket)
        client.socket.close()
        self.bus.detach(client.name)

    def _hand(self, client: _Client, frame: Frame) -> None:
        try:
            client.socket.send(pack(frame))
            client.counters.delivered += 1
        except BlockingIOError:
            client.counters.lost += 1
        except OSError:
            if client.listens_only:  # from the others comes an end of file, after their last frame
                self._disconnect(client)

    def _expired(self) -> None:
        self._timer.expirations()
        self._armed_s = math.inf
        self._pump()

    def _pump(self) -> None:
        """Deliver what is due, let waiting clients on, and wake again for the next delivery."""
        self._accept()  # whoever connected before a frame was sent shall receive it
        for _, receiver, frame in self.bus.advance(self._now_s()):
            if (client := self._clients.get(receiver)) is not None:
                self._hand(client, frame)
        for client in self._clients.values():
            if client.waits_for_room and self.bus.room(client.name) > 0:
                client.waits_for_room = False
                self.running.add_reader(client.socket, self._readable, client)
        due_s = self.bus.next_due_s
        if due_s != self._armed_s:
            if due_s == math.inf:
                self._timer.disarm()
            else:
                self._timer.arm_at(self._start_s + due_s)
            self._armed_s = due_s


def _listen(path: Path) -> socket.socket:
    sock = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET | socket.SOCK_NONBLOCK)
    try:
        if path.is_socket():
            _take_over(path)
        sock.bind(os.fspath(path))
        sock.listen(64)
    except OSError as error:
        sock.close()
        raise BusError(
            f"hub:{path}: no socket can be put there: {error.strerror or error}"
        ) from error
    except BaseException:
        sock.close()
        raise
    return sock


def _take_over(path: Path) -> None:
    """Remove the socket of a hub that has died; BusError if one lives."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET | socket.SOCK_NONBLOCK) as probe:
        try:
            probe.connect(os.fspath(path))
        except ConnectionRefusedError:
            path.unlink()
            return
        except BlockingIOError:  # its backlog is full: it is alive
            pass
    raise BusError(f"hub:{path}: another hub listens there; stop it or choose another path")
