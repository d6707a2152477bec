"""Records on a thread of its own, because the end of a chunk takes tens of milliseconds.

The loop only puts values into a queue; cues and states do not wait for the disk.
"""

from __future__ import annotations

import asyncio
import threading
import time
from collections.abc import Callable
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import Final

from hil.config import RigFile
from hil.errors import RunError
from hil.messages import CommandReply
from hil.runs.recorder import Recorder
from hil.signals import Event

MOST_WAITING: Final = 200_000
"""Calls that may wait for the disk; at a thousand values a second, minutes."""

Write = Callable[[Recorder], None]


class Recording:
    """The gateway's recordings, one after the other; started and stopped by the command `record`."""

    def __init__(
        self, folder: Path, rig_text: str, rig: RigFile, on_end: Callable[[Event], None]
    ) -> None:
        """`on_end` is called, on another thread, when a recording ends by itself."""
        self._folder = folder
        self._rig_text = rig_text
        self._rig = rig
        self._on_end = on_end
        self._thread: RecorderThread | None = None
        self.dropped = 0
        """Values that no recording could take, since the start."""

    @property
    def path(self) -> Path | None:
        """The run folder that is being written; None while nothing is recorded."""
        thread = self._thread
        return thread.path if thread is not None and thread.is_recording else None

    def put(self, write: Write) -> None:
        """Queue a call of the recorder, if there is one; returns at once."""
        if self._thread is not None and not self._thread.put(write):
            self.dropped += 1

    async def start(self) -> CommandReply:
        """Begin a recording, unless one runs."""
        if self.path is not None:
            return CommandReply(True, f"already recording into {self.path}")
        await self.stop("a new recording begins")
        try:
            self._thread = RecorderThread(self._folder, self._rig_text, self._rig, self._on_end)
        except RunError as error:
            return CommandReply(False, f"not recording: {error}")
        return CommandReply(True, f"recording into {self._thread.path}")

    async def stop(self, reason: str) -> CommandReply:
        """End the recording, if one runs; `reason` is kept in its run.toml."""
        thread, self._thread = self._thread, None
        if thread is None:
            return CommandReply(True, "not recording")
        ended = await asyncio.to_thread(thread.stop, reason)
        return CommandReply(ended.severity == "info", ended.text)


class RecorderThread:
    """One recording, from construction to `stop`. RunError where the folder cannot be made."""

    def __init__(
        self, folder: Path, rig_text: str, rig: RigFile, on_end: Callable[[Event], None]
    ) -> None:
        self._recorder = Recorder(folder, rig_text, rig, time.monotonic())
        self.path = self._recorder.path
        self._queue: SimpleQueue[Write | None] = SimpleQueue()
        self._on_end = on_end
        self._reason = "the recorder failed"
        self._thread = threading.Thread(target=self._work, name="recorder", daemon=False)
        self._thread.start()

    @property
    def is_recording(self) -> bool:
        """Whether what is put in is still written."""
        return self._recorder.stopped is None

    def put(self, write: Write) -> bool:
        """Queue a call of the recorder; False if it is too far behind or has ended."""
        if self._queue.qsize() >= MOST_WAITING or not self._thread.is_alive():
            return False
        self._queue.put(write)
        return True

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
            self._recorder.close(self._reason)

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
