"""The gateway process: Zenoh, recording, metrics and log, so that control needs none of them.

It may die at any time; cues then go stale and the rig parks. When control ends or dies the gateway
says so on the network, finishes the recording and leaves.
"""

from __future__ import annotations

import asyncio
import signal
import socket
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Literal

import structlog
import zenoh

from hil import messages
from hil.config import RigFile
from hil.daemon.gateway_commands import Command, PendingCommands, parse_command
from hil.daemon.gateway_cues import CueInlet, RepeatLimiter
from hil.daemon.gateway_recording import Recording
from hil.daemon.gateway_state import Decimator, drive_message, state_message, status_message
from hil.daemon.ipc import Channel, Sources, split_cue
from hil.daemon.metrics import Metrics, MetricsServer
from hil.daemon.records import (
    CueShapedRecord,
    DriveRecord,
    EventRecord,
    FrameRecord,
    GatewayAlive,
    Record,
    ReplyRecord,
    SampleRecord,
    SetpointRecord,
    StateRecord,
)
from hil.daemon.zenoh_session import Arrival, RigSession
from hil.errors import ProtocolError
from hil.frames import StampedFrame
from hil.messages import CommandReply, EventMessage
from hil.signals import Event

ALIVE_S: Final = 0.1
"""Interval of the heartbeat to control."""
SILENCE_S: Final = 1.0
"""Control that says nothing for so long is reported."""
LINGER_S: Final = 10.0
"""After SIGTERM the gateway still records this long how control parks the rig."""

Severity = Literal["info", "warning", "fault"]


@dataclass(frozen=True, slots=True)
class GatewayOptions:
    """What is decided at start and not in the rig file."""

    is_recording: bool = True
    """Record from the start; the command `record` switches it later."""
    runs_folder: Path | None = None
    """Where run folders are made; None: as the rig file says."""
    metrics_port: int | None = None
    """Port on loopback for Prometheus; None: not served, 0: any free one."""
    command_timeout_s: float = 5.0


def run_gateway(
    rig: RigFile, rig_text: str, sock: socket.socket, options: GatewayOptions | None = None
) -> int:
    """Run until control closes its end of `sock`. Returns 0, or 1 if control died in motion.

    RigInUse if the Zenoh endpoint is taken, ConfigError if it cannot be opened.
    """
    sys.setswitchinterval(0.001)  # the recorder's thread must not hold up cues for 5 ms
    return asyncio.run(Gateway(rig, rig_text, sock, options or GatewayOptions()).run())


class Gateway:
    """One rig's gateway; `run` does everything."""

    def __init__(
        self, rig: RigFile, rig_text: str, sock: socket.socket, options: GatewayOptions
    ) -> None:
        self._rig = rig
        self._rig_text = rig_text
        self._options = options
        self._channel = Channel(sock)
        self._commands = PendingCommands(self._channel, options.command_timeout_s)
        self._inlet = CueInlet(rig.coordinates)
        self._repeats = RepeatLimiter()
        self._sources = Sources(rig.actuator_names)
        self._metrics = Metrics(rig.name)
        self._recording = Recording(
            options.runs_folder or Path(rig.recording.folder), rig_text, rig, self._on_recorder_end
        )
        self._state_rate = Decimator(rig.zenoh.state_hz)
        self._drive_rates: dict[tuple[int, str], Decimator] = {}
        self._last_state: StateRecord | None = None
        self._heard_s = time.monotonic()
        self._is_silent = False
        self._clients: set[str] = set()
        self._tasks: set[asyncio.Task[None]] = set()
        self._log = structlog.wrap_logger(
            structlog.PrintLogger(sys.stderr),
            processors=[structlog.processors.add_log_level, structlog.processors.LogfmtRenderer()],
        ).bind(rig=rig.name)
        self._handlers: dict[type, Callable[[Any], None]] = {
            FrameRecord: self._on_frame,
            StateRecord: self._on_state,
            SampleRecord: self._on_sample,
            SetpointRecord: self._on_setpoint,
            CueShapedRecord: lambda record: None,  # clients see its pose as the state's setpoint
            DriveRecord: self._on_drive,
            EventRecord: self._on_event,
            ReplyRecord: self._commands.resolve,
        }

    async def run(self) -> int:
        """Serve until control closes its end; see `run_gateway`."""
        loop = asyncio.get_running_loop()
        self._loop = loop
        self._done = asyncio.Event()
        self._session = RigSession(
            self._rig, on_cue=self._on_cue, on_query=self._on_query, on_client=self._on_client
        )
        server = None
        try:
            self._session.declare(messages.schemas(self._rig.coordinates, self._rig.actuator_names))
            server = self._serve_metrics()
            await self._say_ready()
            loop.add_reader(self._channel.fileno(), self._on_readable)
            self._handle_signals()
            await self._keep_alive()
            return self._farewell()
        finally:
            loop.remove_reader(self._channel.fileno())
            self._commands.abandon("the control process is gone")
            await asyncio.gather(*self._tasks)
            await self._recording.stop("control has ended")
            if server is not None:
                server.close()
            self._session.close()
            self._channel.close()

    async def _say_ready(self) -> None:
        listen = ", ".join(self._rig.zenoh.listen) or self._rig.zenoh.config or "nowhere"
        self._event("info", "gateway_ready", f"clients reach {self._rig.name} at {listen}")
        if self._options.is_recording:
            reply = await self._recording.start()
            self._event("info" if reply.ok else "warning", "recording", reply.message)

    def _serve_metrics(self) -> MetricsServer | None:
        port = self._options.metrics_port
        if port is None:
            return None
        server = MetricsServer(self._metrics.registry, port)
        self._event("info", "metrics_ready", f"metrics at http://127.0.0.1:{server.port}/metrics")
        return server

    def _handle_signals(self) -> None:
        """Ctrl-C and systemd reach both processes; control parks first, and that is recorded."""
        for number in (signal.SIGINT, signal.SIGTERM):
            with suppress(ValueError, RuntimeError):  # not on the main thread
                self._loop.add_signal_handler(number, self._on_signal)

    def _on_signal(self) -> None:
        self._loop.call_later(LINGER_S, self._done.set)

    async def _keep_alive(self) -> None:
        while not self._done.is_set():
            is_recording = self._recording.path is not None
            now_s = time.monotonic()
            self._channel.send(GatewayAlive(now_s, is_recording))
            self._metrics.is_recording.set(is_recording)
            self._metrics.record_drops.set(self._recording.dropped)
            if not self._channel.is_open:
                return
            if now_s - self._heard_s > SILENCE_S and not self._is_silent:
                self._is_silent = True
                self._event(
                    "fault", "control_silent", f"the control process says nothing for {SILENCE_S} s"
                )
            with suppress(TimeoutError):
                await asyncio.wait_for(self._done.wait(), ALIVE_S)

    def _farewell(self) -> int:
        last = self._last_state
        at_rest = last is None or last.state in ("offline", "preparing", "parked", "ready")
        text = f"the control process has ended; the rig was {last.state if last else 'never seen'}"
        if last is not None:
            gone = last._replace(t_s=time.monotonic(), state="offline", fault="control has ended")
            self._publish_state(gone)
        self._event("info" if at_rest else "fault", "control_gone", text)
        return 0 if at_rest else 1

    def _on_readable(self) -> None:
        malformed = self._channel.malformed
        for record in self._channel.receive():
            self._take(record)
        if self._channel.malformed > malformed:
            self._complain("records_malformed", "control", "control sends what is no record")
        if not self._channel.is_open:
            self._done.set()

    def _take(self, record: Record) -> None:
        handler = self._handlers.get(type(record))
        if handler is None:
            self._complain("records_malformed", "control", "control sends a gateway's record")
            return
        try:
            handler(record)
        except ProtocolError as error:
            self._complain("records_malformed", "control", str(error))

    def _on_frame(self, record: FrameRecord) -> None:
        self._metrics.frame(is_sent=record.is_sent)
        stamped = StampedFrame(record.t_s, record.frame)
        self._recording.put(lambda recorder: recorder.frame(stamped, is_sent=record.is_sent))

    def _on_state(self, record: StateRecord) -> None:
        self._last_state = record
        self._heard_s = time.monotonic()
        if self._is_silent:
            self._is_silent = False
            self._event("info", "control_back", "the control process speaks again")
        message = state_message(record, self._rig)
        self._metrics.state(message)
        self._recording.put(lambda recorder: recorder.state(message))
        if self._state_rate.lets(record.t_s):
            self._session.publish("state", messages.encode(message), is_stream=True)

    def _publish_state(self, record: StateRecord) -> None:
        payload = messages.encode(state_message(record, self._rig))
        self._session.publish("state", payload, is_stream=True)

    def _on_sample(self, record: SampleRecord) -> None:
        sample = self._sources.sample(record)
        self._recording.put(lambda recorder: recorder.sample(sample))
        if sample.source == "imu":
            return
        key = (record.source, record.quantity)
        if key not in self._drive_rates:
            self._drive_rates[key] = Decimator(self._rig.zenoh.state_hz)
        if self._drive_rates[key].lets(record.received_s):
            payload = messages.encode(drive_message(record))
            self._session.publish(f"drive/{sample.source}", payload, is_stream=True)

    def _on_drive(self, record: DriveRecord) -> None:
        payload = messages.encode(status_message(record))
        actuator = self._actuator(record.actuator)
        self._session.publish(f"drive/{actuator}/status", payload, is_stream=False)

    def _on_setpoint(self, record: SetpointRecord) -> None:
        values = {self._actuator(record.actuator): record.value}
        self._recording.put(lambda recorder: recorder.setpoint(record.t_s, record.kind, values))

    def _actuator(self, index: int) -> str:
        if index >= len(self._rig.actuators):
            raise ProtocolError(f"a record of actuator {index}, which the rig has not")
        return self._rig.actuator_names[index]

    def _on_event(self, record: EventRecord) -> None:
        self._tell(Event(record.t_s, record.severity, record.name, record.text))

    def _event(self, severity: Severity, name: str, text: str) -> None:
        self._tell(Event(time.monotonic(), severity, name, text))

    def _tell(self, event: Event) -> None:
        """An event of control's or our own: to clients, to the recording and to the log."""
        self._metrics.event(event.severity, event.name)
        payload = messages.encode(EventMessage(event.t_s, event.severity, event.name, event.text))
        self._session.publish("event", payload, is_stream=False)
        self._recording.put(lambda recorder: recorder.event(event))
        log = {"info": self._log.info, "warning": self._log.warning, "fault": self._log.error}
        log[event.severity](event.text, name=event.name)

    def _complain(self, name: str, who: str, text: str) -> None:
        """An event about what somebody keeps doing wrong: one a second, with the count."""
        held_back = self._repeats.lets(f"{name} {who}", time.monotonic())
        if held_back is not None:
            more = f" ({held_back} more like it)" if held_back else ""
            self._event("warning", name, f"from {who}: {text}{more}")

    def _on_cue(self, arrival: Arrival) -> None:
        try:
            cue = self._inlet.accept(arrival)
        except ProtocolError as error:
            self._metrics.cue(is_accepted=False)
            self._complain("cue_refused", arrival.client, str(error))
            return
        self._metrics.cue(is_accepted=True)
        if self._channel.send(*split_cue(cue)) and self._channel.is_open:
            self._complain("cue_lost", arrival.client, "control does not take cues fast enough")
        self._recording.put(lambda recorder: recorder.cue(cue))

    def _on_client(self, change: tuple[str, bool]) -> None:
        name, is_here = change
        (self._clients.add if is_here else self._clients.discard)(name)
        self._metrics.clients.set(len(self._clients))
        verb = "has come" if is_here else "has gone"
        self._event("info", "client_here" if is_here else "client_gone", f"client {name} {verb}")

    def _on_query(self, query: zenoh.Query) -> None:
        task = self._loop.create_task(self._answer(query))
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    async def _answer(self, query: zenoh.Query) -> None:
        key = str(query.key_expr)
        name = key.rpartition("/")[2]
        if "*" in key:
            with suppress(zenoh.ZError), query:
                query.reply_err("a command is given to one key, without wildcards")
            return
        payload = query.payload.to_bytes() if query.payload is not None else None
        try:
            command = parse_command(name, payload)
        except ProtocolError as error:
            reply = CommandReply(False, str(error))
            who = "?"
        else:
            who = command.client or "a client"
            reply = await self._carry_out(command)
            self._metrics.command(command.name, ok=reply.ok)
        self._session.reply(query, messages.encode(reply))
        outcome = "done" if reply.ok else "refused"
        self._event("info", f"command_{outcome}", f"{name[:32]} from {who}: {reply.message}")

    async def _carry_out(self, command: Command) -> CommandReply:
        if command.name != "record":
            return await self._commands.ask(command)
        if command.value:
            return await self._recording.start()
        return await self._recording.stop(f"command of {command.client or 'a client'}")

    def _on_recorder_end(self, event: Event) -> None:
        with suppress(RuntimeError):  # the loop has ended meanwhile
            self._loop.call_soon_threadsafe(self._tell, event)
