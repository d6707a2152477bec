"""Service data objects: reading and writing a node's object dictionary, four bytes at once or in segments.

A `Transfer` is one read or write, told of answers and giving requests; `SdoClient` is the one channel to a
node, which does one transfer at a time: that is its lock. Pure: time comes in, bytes go out. Block transfer
is not used, every node has the other two (CiA 301, 7.2.4) [M].
"""

from __future__ import annotations

import struct
from collections import deque
from typing import Final

from hil.drives.cia402.aborts import CODES, SdoAbort, SdoTimeout
from hil.drives.cia402.codec import SDO_LENGTH
from hil.errors import DriveError, ProtocolError

LONGEST: Final = 65_536
"""A node that announces or sends more than so many bytes is not believed."""

_INITIATE: Final = struct.Struct("<BHB")
_UPLOAD, _UPLOAD_SEGMENT, _DOWNLOAD_SEGMENT = 0x40, 0x60, 0x00
_ABORT: Final = 0x80
_TOGGLE: Final = 0x10


def encode_abort(index: int, sub: int, code: int) -> bytes:
    """An abort frame's data."""
    return _INITIATE.pack(_ABORT, index, sub) + code.to_bytes(4, "little")


class Transfer:
    """One read (`data` None) or write of an object. Once `is_done` there is `result` or `error`."""

    def __init__(self, index: int, sub: int, data: bytes | None = None) -> None:
        self.index, self.sub, self.data = index, sub, data
        self.result: bytes = b""
        self.error: DriveError | None = None
        self.is_done = False
        self._toggle = 0
        self._rest: bytes | None = None  # what a segmented write has still to send
        self._parts: bytearray | None = None  # what a segmented read has got
        self._announced: int | None = None
        self._object = _INITIATE.pack(0, index, sub)[1:]
        self._request = self._first()

    def __str__(self) -> str:
        return f"{'read' if self.data is None else 'write'} of {self.index:#06x}:{self.sub:02x}"

    @property
    def request(self) -> bytes:
        """The data of the request to send, or to send again."""
        return self._request

    def fits(self, answer: bytes) -> bool:
        """Whether an answer can be one to the present request.

        What does not fit is late or doubled and belongs to a request before: a node answers each one that was
        repeated, and CAN may deliver a frame twice. Not so a frame that is no SDO at all: `take` refuses it.
        """
        if len(answer) != SDO_LENGTH:
            return True
        if answer[0] == _ABORT:  # of no object where the node did not understand which
            return answer[1:4] in (self._object, bytes(3))
        if self._parts is not None or self._rest is not None:
            return answer[0] & 0xE0 == (0x00 if self.data is None else 0x20)
        command = 0x40 if self.data is None else 0x60
        return answer[0] & 0xE0 == command and answer[1:4] == self._object

    def take(self, answer: bytes) -> bytes | None:
        """An answer that fits came. Returns the abort to send where it is wrong; None otherwise."""
        if len(answer) != SDO_LENGTH:
            return self._refuse("data_length", f"its answer has {len(answer)} bytes")
        if answer[0] == _ABORT:
            self._fail(SdoAbort(int.from_bytes(answer[4:], "little"), str(self)))
            return None
        if self._parts is not None:
            return self._take_segment(answer)
        if self._rest is not None:
            return self._take_acknowledged(answer[0])
        return self._take_upload(answer) if self.data is None else self._take_download()

    def timed_out(self, waited_s: float) -> bytes:
        """No answer: the transfer has failed; returns the abort to send."""
        self._fail(SdoTimeout(f"{self}: no answer within {waited_s:g} s"))
        return encode_abort(self.index, self.sub, CODES["timeout"])

    def give_up(self, why: str) -> bytes:
        """Nobody waits for it any more; returns the abort to send."""
        self._fail(DriveError(f"{self}: {why}"))
        return encode_abort(self.index, self.sub, CODES["general"])

    def _first(self) -> bytes:
        if self.data is None:
            return _INITIATE.pack(_UPLOAD, self.index, self.sub) + bytes(4)
        size = len(self.data)
        if 1 <= size <= 4:
            return _INITIATE.pack(0x23 | (4 - size) << 2, self.index, self.sub) + self.data.ljust(
                4, b"\0"
            )
        return _INITIATE.pack(0x21, self.index, self.sub) + size.to_bytes(4, "little")

    def _take_upload(self, answer: bytes) -> bytes | None:
        if answer[0] & 0x02:  # expedited
            unused = answer[0] >> 2 & 0x03 if answer[0] & 0x01 else 0
            self._finish(answer[4 : 8 - unused])
            return None
        self._announced = int.from_bytes(answer[4:], "little") if answer[0] & 0x01 else None
        if self._announced is not None and self._announced > LONGEST:
            return self._refuse("out_of_memory", f"it announces {self._announced} bytes")
        self._parts = bytearray()
        self._request = bytes((_UPLOAD_SEGMENT,)) + bytes(7)
        return None

    def _take_segment(self, answer: bytes) -> bytes | None:
        assert self._parts is not None
        if answer[0] & _TOGGLE != self._toggle:
            return self._refuse("toggle_bit", "its segment came twice or was left out")
        self._parts += answer[1 : 8 - (answer[0] >> 1 & 0x07)]
        if len(self._parts) > LONGEST:
            return self._refuse("out_of_memory", "it does not end")
        if answer[0] & 0x01:
            if self._announced is not None and self._announced != len(self._parts):
                text = f"it announced {self._announced} bytes and sent {len(self._parts)}"
                return self._refuse("data_length", text)
            self._finish(bytes(self._parts))
            return None
        self._toggle ^= _TOGGLE
        self._request = bytes((_UPLOAD_SEGMENT | self._toggle,)) + bytes(7)
        return None

    def _take_download(self) -> bytes | None:
        assert self.data is not None
        if 1 <= len(self.data) <= 4:
            self._finish(b"")
            return None
        self._rest = self.data
        self._request = self._segment()
        return None

    def _take_acknowledged(self, command: int) -> bytes | None:
        assert self._rest is not None
        if command & _TOGGLE != self._toggle:
            return self._refuse("toggle_bit", "it acknowledges another segment")
        self._rest = self._rest[7:]
        if not self._rest:
            self._finish(b"")
            return None
        self._toggle ^= _TOGGLE
        self._request = self._segment()
        return None

    def _segment(self) -> bytes:
        assert self._rest is not None
        part = self._rest[:7]
        is_last = len(self._rest) <= 7
        head = _DOWNLOAD_SEGMENT | self._toggle | (7 - len(part)) << 1 | is_last
        return bytes((head,)) + part.ljust(7, b"\0")

    def _refuse(self, name: str, text: str) -> bytes:
        self._fail(SdoAbort(CODES[name], f"{self}: {text}"))
        return encode_abort(self.index, self.sub, CODES[name])

    def _fail(self, error: DriveError) -> None:
        self.error, self.is_done = error, True

    def _finish(self, result: bytes) -> None:
        self.result, self.is_done = result, True


class SdoClient:
    """The one SDO channel to a node: transfers wait in line, one is under way, unanswered ones are repeated.

    A write that starts again is written again: objects are set, never counted up, so that does no harm. A
    repeated segment that had arrived is told by its toggle bit, and the transfer fails. Answers to requests
    before the present one are counted and left alone.
    """

    def __init__(self, timeout_s: float, tries: int) -> None:
        self._timeout_s = timeout_s
        self._tries = tries
        self._line: deque[Transfer] = deque()
        self._now: Transfer | None = None
        self._sent: bytes | None = None
        self._sent_s = 0.0
        self._sends = 0
        self._abort: bytes | None = None
        self.unasked = 0
        """Answers that no transfer waits for."""
        self.surplus = 0
        """Answers less requests since the node was found."""
        self.answered = 0
        self.asked = 0
        self.timeouts = 0

    @property
    def is_idle(self) -> bool:
        """Nothing is under way and nothing waits."""
        return self._now is None and not self._line

    def submit(self, transfer: Transfer) -> Transfer:
        """Put a transfer in line; it has its turn when those before it are done."""
        self._line.append(transfer)
        return transfer

    def withdraw(self, transfer: Transfer) -> None:
        """Nobody waits for a transfer any more: it leaves the line, or is aborted where it is under way."""
        if transfer is self._now:
            self._abort = transfer.give_up("withdrawn")
            self._now = None
        elif transfer in self._line:
            self._line.remove(transfer)

    def reset(self) -> None:
        """The node has restarted: what was under way or in line fails."""
        for transfer in (*filter(None, (self._now,)), *self._line):
            transfer.give_up("the node has begun anew")
        self._line.clear()
        self._now = self._sent = self._abort = None
        self.surplus = 0

    def next_request(self, now_s: float) -> bytes | None:
        """Data of the frame to send to the node now; None while there is none. At most one a call."""
        if self._abort is not None:
            abort, self._abort = self._abort, None
            return abort
        if self._now is None:
            if not self._line:
                return None
            self._now, self._sent, self._sends = self._line.popleft(), None, 0
        if self._sent == self._now.request:
            if now_s - self._sent_s < self._timeout_s:
                return None
            self.timeouts += 1
            if self._sends >= self._tries:
                abort = self._now.timed_out(self._sends * self._timeout_s)
                self._now = None
                return abort
        else:
            self._sends = 0
        self._sent, self._sent_s = self._now.request, now_s
        self._sends += 1
        self.asked += 1
        self.surplus -= 1
        return self._sent

    def on_answer(self, data: bytes) -> None:
        """An SDO answer of the node was received."""
        self.surplus += 1
        if self._now is None or self._sent is None or not self._now.fits(data):
            self.unasked += 1
            return
        self.answered += 1
        self._abort = self._now.take(data)
        if self._now.is_done:
            self._now = None


def to_bytes(value: int, size: int, *, signed: bool) -> bytes:
    """An integer as an object of `size` bytes; ProtocolError where it does not fit."""
    try:
        return value.to_bytes(size, "little", signed=signed)
    except OverflowError:
        raise ProtocolError(
            f"{value} does not fit {size} bytes, {'' if signed else 'un'}signed"
        ) from None
