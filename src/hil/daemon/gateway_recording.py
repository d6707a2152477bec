"""Records on a thread of its own, because the end of a chunk takes tens of milliseconds.

The loop only puts values into a queue; cues and states do not wait for the disk.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import Final

from hil.config import RigFile
from hil.runs.recorder import Recorder
from hil.signals import Event

MOST_WAITING: Final = 200_000
"""Calls that may wait for the disk; at a thousand values a second, minutes."""

Write = Callable[[Recorder], None]


class RecorderThread:
    """One recording, from construction to `stop`. RunError where the folder cannot be made."""

    def __init__(
        self,
        folder: Path,
        rig_text: str,
        rig: RigFile,
        now_s: float,
        on_end: Callable[[Event], None],
    ) -> None:
        """`on_end` is called, on the recorder's thread, when the recording ends by itself."""
        self._recorder = Recorder(folder, rig_text, rig, now_s)
        self.path = self._recorder.path
        self.dropped = 0
        self._queue: SimpleQueue[Write | None] = SimpleQueue()
        self._on_end = on_end
        self._reason = ""
        self._thread = threading.Thread(target=self._work, name="recorder", daemon=False)
        self._thread.start()

    @property
    def is_recording(self) -> bool:
        """Whether what is put in is still written."""
        return self._recorder.stopped is None

    def put(self, write: Write) -> None:
        """Queue a call of the recorder; returns at once."""
        if self._queue.qsize() >= MOST_WAITING or not self._thread.is_alive():
            self.dropped += 1
        else:
            self._queue.put(write)

    def stop(self, reason: str) -> Event:
        """Write what waits, close the files and say how it ended. Blocks: call it off the loop."""
        self._reason = reason
        self._queue.put(None)
        self._thread.join()
        assert self._recorder.stopped is not None
        return self._recorder.stopped

    def _work(self) -> None:
        try:
            self._write_until_stopped()
        finally:
            self._recorder.close(self._reason or "the recorder failed")

    def _write_until_stopped(self) -> None:
        is_told = False
        while True:
            try:
                write = self._queue.get(timeout=0.5)
            except Empty:
                self._recorder.flush()
                continue
            if write is None:
                return
            write(self._recorder)
            if self._recorder.stopped is not None and not is_told:
                is_told = True
                self._on_end(self._recorder.stopped)
