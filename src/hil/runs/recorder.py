"""Writes a run folder while the rig runs.

Everything that was handed over is with the operating system within half a second of rig time, so a
killed process loses less than a second. A disk that fills up, or fails, stops the recorder with an
event and nothing else: no method here raises because of the disk, and what was written stays.
"""

from __future__ import annotations

import contextlib
import os
import shutil
import sys
from collections.abc import Callable, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

from msgspec import Struct

from hil.config import AnyRig, RigFile, bus_of
from hil.config.bicycle import BICYCLE
from hil.errors import RunError
from hil.frames import StampedFrame
from hil.messages import (
    DriveMessage,
    EventMessage,
    ImuMessage,
    RideMessage,
    SetpointMessage,
    StateMessage,
    cue_message,
    encode,
    schemas,
)
from hil.runs.canlog import CAN_LOG, CanLogSink
from hil.runs.folder import (
    EVENTS,
    JOURNAL,
    RECORDING,
    RIG_TOML,
    RUN_TOML,
    STOPPED,
    RunMeta,
    keep_drives,
    lock,
    meta_toml,
    nearest,
    new_folder,
    provenance,
    run_mode,
    write_meta,
)
from hil.runs.journal import JournalSink, JournalSource
from hil.runs.mcapfile import McapSink
from hil.signals import Cue, Event, Sample

FLUSH_S: Final = 0.5
"""Longest stretch of rig time that is held in memory, s."""

RESERVE_BYTES: Final = 64 << 20
"""The recorder stops before the disk is fuller than this: the rig's computer needs the rest."""


class Recorder:
    """One run being recorded.

    `now_s` is the rig's clock at the start; times of all that follows are on the same clock, real
    or simulated. `started` (default: now) is the wall clock at that instant: files carry wall time.
    Raises RunError where the folder cannot be made or the disk is full; from then on `stopped` tells
    of trouble.
    """

    def __init__(
        self,
        folder: Path,
        rig_toml: str,
        rig: AnyRig,
        now_s: float,
        *,
        started: datetime | None = None,
        note: str = "",
        command_line: Sequence[str] = tuple(sys.argv),
        reserve_bytes: int = RESERVE_BYTES,
    ) -> None:
        self._start = started or datetime.now(UTC)
        self._offset_s = self._start.timestamp() - now_s
        self._coordinates = rig.coordinates
        self._reserve = reserve_bytes
        self._flushed_s = now_s
        self._last_s = now_s
        self._imu: dict[str, float] = {}
        self._imu_at = (now_s, now_s)
        self._untold = ""
        """Why recording stopped, while `run.toml` could not be written."""
        self.stopped: Event | None = None
        """Why recording ended before `close`; None while all is well."""
        try:
            self._require_room(nearest(folder))
        except OSError as error:
            raise RunError(f"{folder}: cannot record: {error.strerror}") from error
        self.path = new_folder(folder, rig.name, self._start)
        self._meta = RunMeta(
            rig=rig.name,
            mode=run_mode(rig),
            started=self._start,
            note=note,
            recording=provenance(rig_toml, now_s, command_line),
        )
        try:
            (self.path / RIG_TOML).write_text(rig_toml, encoding="utf-8")
            if isinstance(rig, RigFile):
                keep_drives(self.path, rig)
            write_meta(self.path, self._meta)
            self._events = (self.path / EVENTS).open("wb")
            self._stream = (self.path / RECORDING).open("wb")
            lock(self._stream)
            self._mcap = McapSink(self._stream, schemas(rig.coordinates, rig.actuator_names))
            start_ns = self._nanoseconds(now_s)
            self._mcap.attach(RIG_TOML, "application/toml", rig_toml.encode(), start_ns)
            self._mcap.attach(
                RUN_TOML, "application/toml", meta_toml(self._meta).encode(), start_ns
            )
            self._mcap.flush()
            self._journal = JournalSink(self.path / JOURNAL)
            kind = rig.recording.can_log
            channel = bus_of(rig.can.url)[1].rsplit(":", 1)[-1].rsplit("/", 1)[-1] or "can0"
            self._can = (
                None if kind == "none" else CanLogSink(self.path / CAN_LOG[kind], kind, channel)
            )
        except OSError as error:
            raise RunError(f"{self.path}: cannot record: {error.strerror}") from error

    def sample(self, sample: Sample) -> None:
        """Record a measured value of a drive, of the IMU or of a bicycle (source "bicycle")."""
        t = sample.received_s
        if sample.source == "imu":
            if self._imu_at != (t, sample.sampled_s) or sample.quantity in self._imu:
                self._write_imu()
                self._imu_at = (t, sample.sampled_s)
            self._imu[sample.quantity] = sample.value
            return
        if sample.source == BICYCLE:
            ride = RideMessage(t, sample.sampled_s, **{sample.quantity: sample.value})
            self._write("/ride", "ride", ride, t)
            return
        self.answer(sample.source, t, sample.sampled_s, {sample.quantity: sample.value})

    def answer(
        self, actuator: str, received_s: float, sampled_s: float, values: dict[str, float]
    ) -> None:
        """Record what one frame of a drive said, by quantity."""
        message = DriveMessage(received_s, sampled_s, **values)
        self._write(f"/drive/{actuator}", "drive", message, received_s)

    def setpoint(self, t_s: float, kind: str, values: dict[str, float]) -> None:
        """Record setpoints, by actuator, whose frames were sent at `t_s`."""
        self._write("/setpoint", "setpoint", SetpointMessage(t_s, kind, values), t_s)

    def cue(self, cue: Cue) -> None:
        """Record a cue as it came."""
        self._write("/cue", "cue", cue_message(cue, self._coordinates), cue.received_s)

    def state(self, message: StateMessage) -> None:
        """Record the state of a cycle."""
        self._write("/state", "state", message, message.t)

    def event(self, event: Event) -> None:
        """Record an event, at once on its way to the disk."""
        message = EventMessage(event.t_s, event.severity, event.name, event.text)
        self._write("/event", "event", message, event.t_s)
        self._guarded(lambda: self._append_event(message))

    def frame(self, stamped: StampedFrame, *, is_sent: bool) -> None:
        """Record a frame of the bus."""
        sink = self._can
        if sink is not None:
            t, frame = stamped
            self._guarded(lambda: sink.write(t + self._offset_s, frame, is_sent=is_sent))
            self._advance(t)

    def journal(self, record: bytes) -> None:
        """Record what control was told or sent, as the bytes of its own record, for a replay."""
        if self.stopped is None:
            self._journal.add(record)

    def journal_of(self, earlier: Sequence[Path]) -> None:
        """Begin the journal with those of before: a replay starts where the daemon started."""
        for path in earlier:
            with contextlib.suppress(RunError):  # one that holds nothing
                for stretch in JournalSource(path):
                    self.journal(stretch)
                    self._guarded(lambda: self._journal.flush(self._nanoseconds(self._last_s)))

    def flush(self) -> None:
        """Hand all that was recorded to the operating system; also called every half second."""
        self._write_imu()
        self._guarded(self._flush)

    def close(self, reason: str = "") -> None:
        """End the recording: index, footer, and the end's time and reason in `run.toml`."""
        self._write_imu()
        self._guarded(self._finish)
        self._guarded(lambda: self._note_end(reason))
        self._tell_why()
        self.stopped = self.stopped or Event(
            self._last_s, "info", "recorder_closed", f"the recording {self.path} is complete"
        )
        self._release()

    def _note_end(self, reason: str) -> None:
        assert self._meta.recording is not None
        end_s = self.stopped.t_s if self.stopped else self._last_s
        ended = datetime.fromtimestamp(end_s + self._offset_s, UTC)
        recording = self._meta.recording.model_copy(update={"ended": ended, "end_reason": reason})
        write_meta(self.path, self._meta.model_copy(update={"recording": recording}))

    def _write_imu(self) -> None:
        if self._imu:
            received, sampled = self._imu_at
            message = ImuMessage(received, sampled, **self._imu)
            self._imu = {}
            self._write("/imu", "imu", message, received)

    def _write(self, topic: str, schema: str, message: Struct, t_s: float) -> None:
        self._guarded(
            lambda: self._mcap.write(topic, schema, encode(message), self._nanoseconds(t_s))
        )
        self._advance(t_s)

    def _append_event(self, message: EventMessage) -> None:
        self._events.write(encode(message) + b"\n")
        self._events.flush()

    def _advance(self, t_s: float) -> None:
        self._last_s = max(self._last_s, t_s)
        if t_s - self._flushed_s >= FLUSH_S:
            self._flushed_s = t_s
            self.flush()

    def _flush(self) -> None:
        try:
            self._require_room(self.path)
        except OSError as error:  # nothing has failed yet: the reserve has room for an end
            self._stop(str(error.strerror), self._finish)
            return
        self._mcap.flush()
        self._journal.flush(self._nanoseconds(self._last_s))
        if self._can is not None:
            self._can.flush()

    def _require_room(self, folder: Path) -> None:
        free = shutil.disk_usage(folder).free
        if free < self._reserve:
            raise OSError(0, f"only {free >> 20} MiB are free, {self._reserve >> 20} stay reserved")

    def _finish(self) -> None:
        self._mcap.finish()
        self._journal.finish(self._nanoseconds(self._last_s))
        self._stream.flush()
        os.fsync(self._stream.fileno())

    def _guarded(self, action: Callable[[], None]) -> None:
        """Do `action` unless recording has stopped; an error of the disk stops it."""
        if self.stopped is not None:
            return
        try:
            action()
        except OSError as error:
            self._stop(error.strerror or str(error))

    def _stop(self, why: str, finish: Callable[[], None] = lambda: None) -> None:
        text = f"recording into {self.path} stopped: {why}; the rig goes on without"
        self.stopped = Event(self._last_s, "warning", "recorder_stopped", text)
        message = EventMessage(self._last_s, "warning", "recorder_stopped", text)
        last: tuple[Callable[[], None], ...] = (lambda: self._append_event(message), finish)
        for write in last:
            with contextlib.suppress(OSError):  # no room even for this: `stopped` still says it
                write()
        self._untold = f"{STOPPED}{why}"
        self._tell_why()
        self._release()

    def _tell_why(self) -> None:
        """Note why it stopped, if that is not noted yet; a disk without room for it may have some later."""
        if self._untold:
            with contextlib.suppress(OSError):
                self._note_end(self._untold)
                self._untold = ""

    def _release(self) -> None:
        closers = [self._stream.close, self._events.close, self._journal.close]
        if self._can is not None:
            closers.append(self._can.close)
        for close in closers:
            with contextlib.suppress(OSError):  # what could not be written is lost already
                close()

    def _nanoseconds(self, t_s: float) -> int:
        return round((t_s + self._offset_s) * 1e9)
