"""The socket between control and gateway process: never blocks, drops and counts instead.

The pair is SOCK_SEQPACKET: datagrams with their borders kept, like SOCK_DGRAM, and in addition each
side learns at once that the other has died, which a datagram socket would not tell a reader.
"""

from __future__ import annotations

import errno
import socket
from collections.abc import Sequence
from typing import Final

from hil.daemon.records import Record, SampleRecord
from hil.daemon.wire import datagram, decode_with_bytes, encode
from hil.errors import ProtocolError
from hil.signals import Sample

MAX_DATAGRAM: Final = 32 * 1024
BUFFER_BYTES: Final = 4 * 1024 * 1024
"""Asked of the kernel, which grants at most net.core.wmem_max; half a second of a busy rig fits."""

AT_ONCE: Final = 4
"""Datagrams read before anything else of the loop has its turn: cues must not wait behind the frames of a
flooded bus. Who cannot keep up loses records, not cues."""


def socket_pair() -> tuple[socket.socket, socket.socket]:
    """Two connected sockets, one for each process; a child is given its end's file descriptor."""
    return socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)


class Channel:
    """One end of the socket. `send` and `receive` return at once, whatever the peer does."""

    def __init__(self, sock: socket.socket) -> None:
        sock.setblocking(False)
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, BUFFER_BYTES)
        self._socket = sock
        self.dropped = 0
        """Records that found the peer's queue full or the peer gone."""
        self.malformed = 0
        """Datagrams that were not understood."""
        self.is_open = True
        """False once the peer has closed its end or died."""

    def fileno(self) -> int:
        """File descriptor, for `loop.add_reader`."""
        return self._socket.fileno()

    def send(self, *records: Record) -> int:
        """Send records, in order, in as few datagrams as hold them; returns how many were lost."""
        dropped = 0
        batch: list[bytes] = []
        size = 0
        for encoded in map(encode, records):
            if size + len(encoded) > MAX_DATAGRAM:
                dropped += self._send(batch)
                batch, size = [], 0
            batch.append(encoded)
            size += len(encoded)
        if batch:
            dropped += self._send(batch)
        self.dropped += dropped
        return dropped

    def _send(self, batch: Sequence[bytes]) -> int:
        try:
            self._socket.send(datagram(batch), socket.MSG_NOSIGNAL)
        except BlockingIOError:
            return len(batch)
        except (BrokenPipeError, ConnectionError):
            self.is_open = False
            return len(batch)
        except OSError as error:
            if error.errno != errno.ENOBUFS:  # as good as a full queue
                raise
            return len(batch)
        return 0

    def receive(self, most: int = AT_ONCE) -> list[Record]:
        """Records that wait, from at most `most` datagrams; empty if there are none."""
        return [record for record, _ in self.receive_with_bytes(most)]

    def receive_with_bytes(self, most: int = AT_ONCE) -> list[tuple[Record, bytes]]:
        """Records that wait, each with its bytes."""
        records: list[tuple[Record, bytes]] = []
        for _ in range(most):
            try:
                raw = self._socket.recv(MAX_DATAGRAM + 2)
            except BlockingIOError:
                break
            except ConnectionError:
                raw = b""
            if not raw:
                self.is_open = False
                break
            try:
                records += decode_with_bytes(raw)
            except ProtocolError:
                self.malformed += 1
        return records

    def close(self) -> None:
        """Close this end; the peer's `is_open` becomes false."""
        self.is_open = False
        self._socket.close()


class Sources:
    """Turns samples into records and back: records name sources by their index in the rig file."""

    def __init__(self, actuator_names: Sequence[str]) -> None:
        self.names = (*actuator_names, "imu")
        self._index = {name: i for i, name in enumerate(self.names)}

    def record(self, sample: Sample) -> SampleRecord:
        """The record of `sample`; ProtocolError if the rig has no such source."""
        if sample.source not in self._index:
            raise ProtocolError(f"{sample.source!r} is none of {', '.join(self.names)}")
        return SampleRecord(
            self._index[sample.source],
            sample.quantity,
            sample.value,
            sample.sampled_s,
            sample.received_s,
        )

    def sample(self, record: SampleRecord) -> Sample:
        """The sample in `record`; ProtocolError if the rig has no such source."""
        if record.source >= len(self.names):
            raise ProtocolError(f"source {record.source} is none of the rig's {len(self.names)}")
        return Sample(
            self.names[record.source],
            record.quantity,
            record.value,
            record.sampled_s,
            record.received_s,
        )
