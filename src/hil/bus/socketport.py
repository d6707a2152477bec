"""A port on a socket whose messages are `struct can_frame` records: the one seam to any bus."""

from __future__ import annotations

import errno
import math
import socket
import time
from typing import Final

from hil.bus.clocks import STAMP_ROOM, monotonic_minus_realtime_s, received_s, request_stamps
from hil.bus.state import ERR_BUS_OFF, BusState, PortCounters, controller_error, state_after
from hil.errors import BusBusy, BusError, BusOff, ProtocolError
from hil.frames import FRAME_BYTES, Frame, StampedFrame, pack, unpack

_DRAIN_LIMIT: Final = 512
"""Records read in one call: a bus that floods must not keep the loop from its next cycle."""

SEND_BUFFER: Final = 12_288
"""SO_SNDBUF of ports on Unix sockets. The kernel doubles it and reckons 768 bytes a record, so
about 32 frames fit: the burst of one cycle, but no queue in which commands grow old."""

_FULL: Final = frozenset({errno.ENOBUFS, errno.EAGAIN})


class SocketPort:
    """A `BusPort` on `sock`, which it owns from here on.

    `name` is the port's URL; `remedy` says in half a sentence what to do when the bus is lost.
    With `only_from`, records of other interfaces are passed over (a socket on all of them).
    """

    def __init__(
        self,
        name: str,
        sock: socket.socket,
        *,
        read_only: bool,
        remedy: str,
        only_from: str | None = None,
    ) -> None:
        sock.setblocking(False)
        request_stamps(sock)
        self.name = name
        self.read_only = read_only
        self.counters = PortCounters()
        self.state = BusState.ERROR_ACTIVE
        self._socket = sock
        self._remedy = remedy
        self._only_from = only_from
        self._deferred: BusError | None = None
        self._last_s = -math.inf
        self._is_down = False

    def fileno(self) -> int:
        """The descriptor that is readable when frames wait; -1 once closed."""
        return self._socket.fileno()

    def receive(self) -> list[StampedFrame]:
        """What has arrived, oldest first, without waiting; BusError when the bus is lost.

        Frames that came before the loss are handed out first. A call reads a bounded number of
        records, so that after a flood the descriptor may still be readable. An interface that is
        set down is off the bus, not lost: that comes as the error frame of a controller.
        """
        if self._deferred is not None:
            error, self._deferred = self._deferred, None
            raise error
        frames: list[StampedFrame] = []
        trouble: OSError | None = None
        offset_s, now_s = monotonic_minus_realtime_s(), time.monotonic()
        for _ in range(_DRAIN_LIMIT):
            try:
                record, ancillary, _, address = self._socket.recvmsg(FRAME_BYTES + 1, STAMP_ROOM)
            except BlockingIOError:
                break
            except ConnectionResetError:  # Unix sockets tell this before the last records
                continue
            except (
                OSError
            ) as cause:  # CAN sockets tell it once, before the frames that came earlier
                if trouble is not None:
                    break
                trouble = cause
                continue
            if not record and not ancillary:  # an empty record would carry a stamp
                self._defer(self._lost("the other end has closed"), frames)
                break
            if self._only_from is not None and address[0] != self._only_from:
                continue
            try:
                frame = unpack(record)
            except ProtocolError:
                self.counters.malformed += 1
                continue
            self._is_down = False
            self.state = state_after(frame, self.state)
            # The clocks' offset is read anew for each call, and a process may be interrupted between the
            # two readings: stamps of successive calls can cross by that, frames cannot.
            self._last_s = max(self._last_s, received_s(ancillary, offset_s, now_s))
            frames.append(StampedFrame(self._last_s, frame))
        if trouble is not None and trouble.errno == errno.ENETDOWN:
            self._is_down, self.state = True, BusState.BUS_OFF
            frames.append(StampedFrame(now_s, controller_error(ERR_BUS_OFF)))
        self.counters.received += len(frames)
        if trouble is not None and trouble.errno != errno.ENETDOWN:
            self._defer(self._lost(trouble.strerror or str(trouble)), frames)
        return frames

    def send(self, frame: Frame) -> None:
        """Give `frame` to the bus without waiting.

        BusBusy when the transmit queue is full, BusOff when the controller has left the bus,
        BusError when the port is read-only or the bus is lost, ProtocolError for no data or
        remote frame. What raises was not sent.
        """
        try:
            self._send(frame)
        except (BusError, ProtocolError):
            self.counters.refused += 1
            raise
        self.counters.sent += 1

    def close(self) -> None:
        """Leave the bus and give the descriptor back; closing twice is no error."""
        self._socket.close()

    def _send(self, frame: Frame) -> None:
        if self.read_only:
            raise BusError(f"{self.name} is open for reading only: it cannot transmit")
        if frame.is_error:
            raise ProtocolError(f"{self.name}: error frames are the controller's, not ours to send")
        if self.state is BusState.BUS_OFF and not self._is_down:
            raise BusOff(
                f"{self.name}: the controller has left the bus after too many errors; check "
                "wiring, termination and bit rate, then restart it"
            )
        try:
            self._socket.send(pack(frame))
        except OSError as cause:
            if cause.errno in _FULL:
                raise BusBusy(
                    f"{self.name}: the transmit queue is full; the bus carries less than is sent"
                ) from cause
            if cause.errno == errno.ENETDOWN:
                self._is_down, self.state = True, BusState.BUS_OFF
                raise BusOff(f"{self.name}: the interface is down; {self._remedy}") from cause
            raise self._lost(cause.strerror or str(cause)) from cause
        if self._is_down:  # nobody tells that it is up again, but that it takes frames
            self._is_down, self.state = False, BusState.ERROR_ACTIVE

    def _lost(self, reason: str) -> BusError:
        return BusError(f"{self.name}: {reason}; {self._remedy}")

    def _defer(self, error: BusError, frames: list[StampedFrame]) -> None:
        """Raise at once, or with the next call if there are frames to hand out first."""
        if not frames:
            raise error
        self._deferred = error
