"""The drive's side of SDO: requests in, answers out; expedited and segmented, one transfer at a time.

Written apart from `hil.drives.cia402.sdo`, which is the master's side, and held against the `canopen`
package's by the tests (CiA 301, 7.2.4) [M].
"""

from __future__ import annotations

from collections.abc import Callable

from hil.drives.cia402.aborts import CODES, SdoAbort
from hil.drives.cia402.sdo import encode_abort

Read = Callable[[int, int], bytes]
Write = Callable[[int, int, bytes], None]


class SdoServer:
    """Serves one client; `read` and `write` raise SdoAbort where the object does not allow it."""

    def __init__(self, read: Read, write: Write) -> None:
        self._read, self._write = read, write
        self.reset()

    def reset(self) -> None:
        """Forget the transfer under way."""
        self._key = (0, 0)
        self._reading: bytes | None = None
        self._writing: bytearray | None = None
        self._announced: int | None = None
        self._toggle = 0

    def on_request(self, data: bytes) -> bytes | None:
        """The answer to a request; None to an abort and to what is no SDO."""
        if len(data) != 8 or data[0] == 0x80:
            self.reset()
            return None
        try:
            return self._answer(data)
        except SdoAbort as abort:
            index, sub = self._key
            self.reset()
            return encode_abort(index, sub, abort.code)

    def _answer(self, data: bytes) -> bytes:
        command = data[0] >> 5
        if command in (1, 2):
            self.reset()
            self._key = (data[1] | data[2] << 8, data[3])
            return self._start_write(data) if command == 1 else self._start_read()
        if command == 0 and self._writing is not None:
            return self._write_segment(data)
        if command == 3 and self._reading is not None:
            return self._read_segment(data)
        raise SdoAbort(CODES["unknown_command"])

    def _head(self, command: int) -> bytes:
        index, sub = self._key
        return bytes((command, index & 0xFF, index >> 8, sub))

    def _start_read(self) -> bytes:
        value = self._read(*self._key)
        if 1 <= len(value) <= 4:
            return self._head(0x43 | (4 - len(value)) << 2) + value.ljust(4, b"\0")
        self._reading = value
        return self._head(0x41) + len(value).to_bytes(4, "little")

    def _read_segment(self, data: bytes) -> bytes:
        self._check_toggle(data[0])
        assert self._reading is not None
        part, self._reading = self._reading[:7], self._reading[7:]
        is_last = not self._reading
        head = self._toggle | (7 - len(part)) << 1 | is_last
        self._toggle ^= 0x10
        if is_last:
            self._reading = None
        return bytes((head,)) + part.ljust(7, b"\0")

    def _start_write(self, data: bytes) -> bytes:
        if data[0] & 0x02:
            size = 4 - (data[0] >> 2 & 3) if data[0] & 0x01 else 4
            self._write(*self._key, data[4 : 4 + size])
        else:
            self._announced = int.from_bytes(data[4:], "little") if data[0] & 0x01 else None
            self._writing = bytearray()
        return self._head(0x60) + bytes(4)

    def _write_segment(self, data: bytes) -> bytes:
        self._check_toggle(data[0])
        assert self._writing is not None
        self._writing += data[1 : 8 - (data[0] >> 1 & 7)]
        answer = bytes((0x20 | self._toggle,)) + bytes(7)
        self._toggle ^= 0x10
        if data[0] & 0x01:
            value, self._writing = bytes(self._writing), None
            if self._announced not in (None, len(value)):
                raise SdoAbort(CODES["data_length"])
            self._write(*self._key, value)
        return answer

    def _check_toggle(self, command: int) -> None:
        if command & 0x10 != self._toggle:
            raise SdoAbort(CODES["toggle_bit"])
