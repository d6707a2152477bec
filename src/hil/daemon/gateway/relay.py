"""What control tells, passed on: to clients at a bearable rate, to the recording in full."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any, Final

from hil import messages
from hil.config import RigFile
from hil.daemon.gateway.commands import PendingCommands
from hil.daemon.gateway.events import Events
from hil.daemon.gateway.recording import Recording
from hil.daemon.gateway.state import Decimator, drive_message, state_message, status_message
from hil.daemon.ipc import Channel, Sources
from hil.daemon.metrics import Metrics
from hil.daemon.recording import keep
from hil.daemon.records import (
    CommandRecord,
    CueRecord,
    DriveRecord,
    EventRecord,
    FrameRecord,
    InputRecord,
    Record,
    ReplyRecord,
    SampleRecord,
    SetpointRecord,
    StateRecord,
)
from hil.daemon.zenoh_session import RigSession
from hil.errors import ProtocolError
from hil.signals import Event

SILENCE_S: Final = 1.0
"""Control that says nothing for so long is reported."""


class Relay:
    """The way from control to everybody else."""

    def __init__(
        self,
        rig: RigFile,
        channel: Channel,
        session: RigSession,
        recording: Recording,
        metrics: Metrics,
        events: Events,
        commands: PendingCommands,
    ) -> None:
        self._rig = rig
        self._channel = channel
        self._session = session
        self._recording = recording
        self._metrics = metrics
        self._events = events
        self._commands = commands
        self._sources = Sources(rig.actuator_names)
        self._state_rate = Decimator(rig.zenoh.state_hz)
        self._drive_rates: dict[tuple[int, str], Decimator] = {}
        self._heard_s = 0.0
        self._is_silent = False
        self.last_state: StateRecord | None = None
        self._kept: list[tuple[Record, bytes | None]] = []
        self._raw = b""
        self._handlers: dict[type, Callable[[Any], None]] = {
            FrameRecord: self._on_frame,
            StateRecord: self._on_state,
            SampleRecord: self._on_sample,
            SetpointRecord: self._on_setpoint,
            DriveRecord: self._on_drive,
            EventRecord: self._on_event,
            ReplyRecord: commands.resolve,
            **dict.fromkeys((InputRecord, CueRecord, CommandRecord), self._keep),
        }

    def on_readable(self) -> bool:
        """Pass on what waits in the channel; False if nothing did."""
        malformed = self._channel.malformed
        records = self._channel.receive_with_bytes()
        for record, self._raw in records:
            self._take(record)
        self._record()
        if self._channel.malformed > malformed:
            self._events.complain("records_malformed", "control", "what it sends is no record")
        return bool(records)

    def watch(self, now_s: float) -> None:
        """Report a control process that lives and says nothing, once, and when it is back."""
        if self.last_state is None or self._is_silent == (now_s - self._heard_s > SILENCE_S):
            return
        self._is_silent = not self._is_silent
        if self._is_silent:
            text = f"the control process says nothing for {SILENCE_S:g} s"
            self._events.say("fault", "control_silent", text)
        else:
            self._events.say("info", "control_back", "the control process speaks again")

    def publish_end(self) -> None:
        """The last state that clients see: offline, because control has ended."""
        if self.last_state is not None:
            last = self.last_state._replace(
                t_s=time.monotonic(), state="offline", fault="the control process has ended"
            )
            self._publish_state(last)

    def _take(self, record: Record) -> None:
        handler = self._handlers.get(type(record))
        if handler is None:
            self._events.complain("records_malformed", "control", "it sends a gateway's record")
            return
        try:
            handler(record)
        except ProtocolError as error:
            self._events.complain("records_malformed", "control", str(error))

    def _keep(self, record: Record) -> None:
        """To be recorded. Indices have been checked by now: nothing fails on the recorder's thread."""
        self._kept.append((record, self._raw))

    def _record(self) -> None:
        """Hand over what is to be recorded, all at once."""
        if self._kept:
            kept, self._kept = self._kept, []
            self._recording.put(
                lambda recorder: keep(recorder, kept, self._rig, self._sources), len(kept)
            )

    def _on_frame(self, record: FrameRecord) -> None:
        self._metrics.frame(is_sent=record.is_sent)
        self._keep(record)

    def _on_state(self, record: StateRecord) -> None:
        self.last_state = record
        self._commands.has_begun = True
        self._heard_s = time.monotonic()
        self._metrics.state(record)
        self._keep(record)
        if self._state_rate.lets(record.t_s):
            self._publish_state(record)

    def _publish_state(self, record: StateRecord) -> None:
        payload = messages.encode(state_message(record, self._rig))
        self._session.publish("state", payload, is_stream=True)

    def _on_sample(self, record: SampleRecord) -> None:
        source = self._sources.sample(record).source
        self._keep(record)
        if source == "imu":
            return
        key = (record.source, record.quantity)
        if key not in self._drive_rates:
            self._drive_rates[key] = Decimator(self._rig.zenoh.state_hz)
        if self._drive_rates[key].lets(record.received_s):
            payload = messages.encode(drive_message(record))
            self._session.publish(f"drive/{source}", payload, is_stream=True)

    def _on_setpoint(self, record: SetpointRecord) -> None:
        self._actuator(record.actuator)
        self._keep(record)

    def _on_drive(self, record: DriveRecord) -> None:
        payload = messages.encode(status_message(record))
        actuator = self._actuator(record.actuator)
        self._session.publish(f"drive/{actuator}/status", payload, is_stream=False)

    def _actuator(self, index: int) -> str:
        if index >= len(self._rig.actuators):
            raise ProtocolError(f"a record of actuator {index}, which the rig has not")
        return self._rig.actuator_names[index]

    def _on_event(self, record: EventRecord) -> None:
        self._events.tell(Event(record.t_s, record.severity, record.name, record.text))
