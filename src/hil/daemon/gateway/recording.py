"""Records on a thread of its own, because the end of a chunk takes tens of milliseconds.

The loop only puts values into a queue; cues and states do not wait for the disk. While nothing is recorded,
the journal alone is kept, so that a recording switched on later can be replayed too.
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
from hil.runs.between import MOST_BYTES, Between
from hil.runs.folder import JOURNAL
from hil.runs.recorder import Recorder
from hil.signals import Event

MOST_WAITING: Final = 200_000
"""Values that may wait for the disk; at a thousand a second, minutes."""

AnyRecorder = Recorder | Between
Write = Callable[[AnyRecorder], None]


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
        self._told: list[RecorderThread] = []
        """Whose journals, one after the other, hold all that control was told from its start on."""
        self._can_keep = True
        self.dropped = 0
        """Values that no recording could take, since the start."""

    @property
    def path(self) -> Path | None:
        """The run folder that is being written; None while nothing is recorded."""
        thread = self._thread
        return thread.path if thread is not None and thread.is_recording else None

    def put(self, write: Write, values: int = 1) -> None:
        """Queue a call of the recorder that writes so many values, if there is one; returns at once."""
        if self._thread is None:
            self._keep_the_journal()
        if self._thread is not None and not self._thread.put(write, values):
            self.dropped += values

    async def start(self) -> CommandReply:
        """Begin a recording, unless one runs."""
        if self.path is not None:
            return CommandReply(True, f"already recording into {self.path}", str(self.path))
        try:
            recorder = Recorder(self._folder, self._rig_text, self._rig, time.monotonic())
        except RunError as error:
            return CommandReply(False, f"not recording: {error}")
        earlier, old = self._told, self._thread
        self._thread = RecorderThread(recorder, self._on_end, earlier)
        self._told = [self._thread]
        if old is not None:
            await asyncio.to_thread(old.stop, "a new recording begins")
        return CommandReply(True, f"recording into {recorder.path}", str(recorder.path))

    async def stop(self, reason: str) -> CommandReply:
        """End the recording, if one runs; `reason` is kept in its run.toml."""
        thread = self._thread
        if thread is None or not isinstance(thread.recorder, Recorder):
            return CommandReply(True, "not recording")
        self._thread = None
        self._keep_the_journal()
        ended = await asyncio.to_thread(thread.stop, reason)
        return CommandReply(ended.severity == "info", ended.text)

    async def close(self, reason: str) -> None:
        """End the recording, and what is kept besides: the gateway ends."""
        self._can_keep = False
        await self.stop(reason)
        for thread in {*self._told, *([self._thread] if self._thread else [])}:
            await asyncio.to_thread(thread.stop, reason)
            if isinstance(thread.recorder, Between):
                thread.recorder.discard()

    def _keep_the_journal(self) -> None:
        if not self._can_keep:
            return
        try:
            self._thread = RecorderThread(Between(self._folder), self._on_end, [])
        except RunError:  # no room: what is recorded later begins in the middle, and says so
            self._can_keep = False
            return
        self._told = [*self._told, self._thread]


class RecorderThread:
    """One recorder at work, from construction to `stop`; first it takes over the journals of `earlier`."""

    def __init__(
        self,
        recorder: AnyRecorder,
        on_end: Callable[[Event], None],
        earlier: list[RecorderThread],
    ) -> None:
        self.recorder = recorder
        self._earlier = earlier
        self._queue: SimpleQueue[tuple[Write, int] | None] = SimpleQueue()
        self._given = self._taken = 0  # values; each is counted by one thread alone
        self._on_end = on_end
        self._reason = "the recorder failed"
        self._thread = threading.Thread(target=self._work, name="recorder", daemon=False)
        self._thread.start()

    @property
    def path(self) -> Path | None:
        """The run folder, if there is one."""
        return self.recorder.path if isinstance(self.recorder, Recorder) else None

    @property
    def journal(self) -> Path:
        """The file of the journal."""
        return self.recorder.path if self.path is None else self.path / JOURNAL

    @property
    def is_recording(self) -> bool:
        """Whether what is put in is still written."""
        return self.recorder.stopped is None

    def put(self, write: Write, values: int = 1) -> bool:
        """Queue a call of the recorder; False if it is too far behind or has ended."""
        if self._given - self._taken >= MOST_WAITING or not self._thread.is_alive():
            return False
        self._given += values
        self._queue.put((write, values))
        return True

    def stop(self, reason: str) -> Event:
        """Write what waits, close the files and say how it ended. Blocks: call it off the loop."""
        if self._thread.is_alive():
            self._reason = reason
            self._queue.put(None)
            self._thread.join()
        assert self.recorder.stopped is not None
        return self.recorder.stopped

    def _work(self) -> None:
        try:
            self._take_over()
            self._write_until_stopped()
        finally:
            self.recorder.close(self._reason)

    def _take_over(self) -> None:
        earlier, self._earlier = self._earlier, []
        for thread in earlier:
            thread.stop("a new recording begins")
        journals = [thread.journal for thread in earlier]
        whole = all(t.recorder.is_whole for t in earlier if isinstance(t.recorder, Between))
        if isinstance(self.recorder, Recorder) and whole and _size(journals) <= MOST_BYTES:
            self.recorder.journal_of([path for path in journals if path.is_file()])
        for thread in earlier:
            if isinstance(thread.recorder, Between):
                thread.recorder.discard()

    def _write_until_stopped(self) -> None:
        is_told = False
        while True:
            try:
                item = self._queue.get(timeout=0.5)
            except Empty:
                self.recorder.flush()
                continue
            if item is None:
                return
            write, values = item
            write(self.recorder)
            self._taken += values
            if self.recorder.stopped is not None and not is_told:
                is_told = True
                self._on_end(self.recorder.stopped)


def _size(journals: list[Path]) -> int:
    return sum(path.stat().st_size for path in journals if path.is_file())
