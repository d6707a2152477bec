"""The journal of a run: all that the control process was told and sent, in order and to the bit.

The bytes are the daemon's own records; here they are only kept, compressed and checksummed, in an MCAP
file beside the recording, so that recordings stay readable by everybody's tools.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Final

from hil.errors import RunError
from hil.runs.folder import JOURNAL
from hil.runs.mcapfile import McapSink, McapSource

ENCODING: Final = "hil.daemon.wire/1"
"""Name and version of the records' layout, as the file tells it."""
_TOPIC: Final = "/journal"


class JournalSink:
    """Writes a new journal; what was added reaches the operating system with `flush`."""

    def __init__(self, path: Path) -> None:
        self._stream = path.open("wb")
        self._mcap = McapSink(self._stream, {}, ENCODING)
        self._waiting = bytearray()

    def add(self, record: bytes) -> None:
        """Keep the bytes of one record."""
        self._waiting += record

    def flush(self, time_ns: int) -> None:
        """Write what was added as one message, stamped in ns since 1970."""
        if self._waiting:
            self._mcap.write(_TOPIC, "", bytes(self._waiting), time_ns)
            self._waiting.clear()
        self._mcap.flush()

    def finish(self, time_ns: int) -> None:
        """Write what is left, index and footer."""
        self.flush(time_ns)
        self._mcap.finish()
        self._stream.flush()

    def close(self) -> None:
        """Give the file back."""
        self._stream.close()


class JournalSource:
    """Iterates over stretches of whole records of a journal: that of a run folder, or the file itself.

    RunError where there is none. `damage` is a sentence after the iteration if the file is cut or hurt.
    """

    def __init__(self, folder: Path) -> None:
        self.path = folder if folder.is_file() else folder / JOURNAL
        if not self.path.is_file():
            raise RunError(
                f"{folder}: has no {JOURNAL}, so it cannot be replayed; only runs that the daemon of "
                "this version records have one"
            )
        self.damage: str | None = None

    def __iter__(self) -> Iterator[bytes]:
        source = McapSource(self.path, ENCODING)
        count = 0
        for message in source:
            count += 1
            yield message.data
        self.damage = source.damage
        if not count:
            raise RunError(
                f"{self.path}: holds nothing that this version of hil ({ENCODING}) reads"
            )
