"""Stands in for a recorder while nothing is recorded: keeps the journal, and that alone.

A journal can be replayed only from the daemon's start. What control is told before a recording is switched
on is therefore kept in a file without a name in the runs' folder, for the recording that may come.
"""

from __future__ import annotations

import os
import tempfile
from pathlib import Path
from typing import Final

from hil.errors import RunError
from hil.frames import StampedFrame
from hil.messages import StateMessage
from hil.runs.journal import JournalSink
from hil.signals import Cue, Event, Sample

MOST_BYTES: Final = 1 << 30
"""More is not kept, some hours of a rig: recordings that begin later cannot be replayed."""
FLUSH_BYTES: Final = 1 << 18


class Between:
    """Takes what a `Recorder` takes. RunError where its file cannot be made.

    `is_whole` says whether all that it was given is in the file at `path`.
    """

    def __init__(self, folder: Path, most_bytes: int = MOST_BYTES) -> None:
        try:
            folder.mkdir(parents=True, exist_ok=True)
            self._handle, name = tempfile.mkstemp(".mcap", ".journal-", folder)
            self._sink = JournalSink(Path(name))
            Path(name).unlink()  # nothing is left behind, however this process ends
        except OSError as error:
            raise RunError(f"{folder}: the journal cannot be kept: {error.strerror}") from error
        self.path = Path(f"/proc/self/fd/{self._handle}")
        self._left = most_bytes
        self._waiting = 0
        self.is_whole = True
        self.stopped: Event | None = None

    def journal(self, record: bytes) -> None:
        """Keep the bytes of one record of what control was told or sent."""
        self._left -= len(record)
        self._waiting += len(record)
        if self._left < 0:
            self.is_whole = False
        if self.is_whole and self.stopped is None:
            self._sink.add(record)
            if self._waiting >= FLUSH_BYTES:
                self.flush()

    def flush(self) -> None:
        """Hand what was kept to the operating system."""
        self._waiting = 0
        try:
            self._sink.flush(0)
        except OSError:
            self.is_whole = False

    def close(self, reason: str = "") -> None:
        """End the file."""
        try:
            self._sink.finish(0)
            self._sink.close()
        except OSError:
            self.is_whole = False
        self.stopped = Event(0.0, "info", "recorder_closed", reason or "not recording")

    def discard(self) -> None:
        """Give the file back, once it is closed and read."""
        if self._handle >= 0:
            os.close(self._handle)
            self._handle = -1

    def sample(self, sample: Sample) -> None:
        """Not kept."""

    def answer(
        self, actuator: str, received_s: float, sampled_s: float, values: dict[str, float]
    ) -> None:
        """Not kept."""

    def setpoint(self, t_s: float, kind: str, values: dict[str, float]) -> None:
        """Not kept."""

    def cue(self, cue: Cue) -> None:
        """Not kept: what control made of it is in the journal."""

    def state(self, message: StateMessage) -> None:
        """Not kept."""

    def event(self, event: Event) -> None:
        """Not kept."""

    def frame(self, stamped: StampedFrame, *, is_sent: bool) -> None:
        """Not kept here: it is in the journal as well."""
