"""The log: one line an event on standard error, for the journal, written on a thread of its own.

A pipe that nobody empties, a journal that stalls and a terminal held by Ctrl-S block whoever writes. Here
that is a thread that does nothing else; what does not fit into its queue is lost and counted.
"""

from __future__ import annotations

import os
import select
from queue import SimpleQueue
from threading import Thread
from typing import Final

from structlog.processors import LogfmtRenderer

from hil.signals import Severity

MOST_WAITING: Final = 1000
"""Lines that may wait for whoever reads standard error."""
CLOSE_S: Final = 1.0
"""At the end what waits is given so long to be read."""
LEVELS: Final[dict[Severity, str]] = {"info": "info", "warning": "warning", "fault": "error"}


class Log:
    """The log of one rig. Nothing here waits for the reader but `close`, and that not for long."""

    def __init__(self, rig: str, fd: int = 2) -> None:
        self._rig = rig
        # not sys.stderr: a thread that is stuck in its buffer aborts the interpreter's exit
        self._fd = fd
        self._render = LogfmtRenderer()
        self._lines: SimpleQueue[str | None] = SimpleQueue()
        self._thread = Thread(target=self._work, name="log", daemon=True)
        self._thread.start()
        self.dropped = 0
        """Lines that found no room."""

    @property
    def waiting(self) -> int:
        """Lines that nobody has read yet."""
        return self._lines.qsize()

    def event(self, severity: Severity, name: str, text: str) -> None:
        """One line about an event."""
        words = {"rig": self._rig, "name": name, "event": text, "level": LEVELS[severity]}
        self.write(f"{self._render(None, '', words)}\n")

    def write(self, text: str) -> None:
        """One line or several as they are: the face of a stream, for `logging`."""
        if self.waiting >= MOST_WAITING:
            self.dropped += 1
        else:
            self._lines.put(text)

    def flush(self) -> None:
        """Streams have it; lines are on their way anyhow."""

    def close(self) -> None:
        """Wait until all is written, or for `CLOSE_S`."""
        self._lines.put(None)
        self._thread.join(CLOSE_S)

    def _work(self) -> None:
        while (text := self._lines.get()) is not None:
            rest = text.encode(errors="replace")
            while rest:
                try:
                    rest = rest[os.write(self._fd, rest) :]
                except BlockingIOError:  # a descriptor that others made so
                    select.select((), (self._fd,), ())
                except OSError:  # whoever read it is gone: nobody misses it
                    break
