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
from contextlib import suppress
from pathlib import Path
from typing import Final

from hil import messages
from hil.config import RigFile
from hil.daemon.gateway.clients import Clients
from hil.daemon.gateway.commands import PendingCommands
from hil.daemon.gateway.events import Events
from hil.daemon.gateway.options import GatewayOptions
from hil.daemon.gateway.recording import Recording
from hil.daemon.gateway.relay import Relay
from hil.daemon.ipc import Channel
from hil.daemon.leaving import control_s
from hil.daemon.log import Log
from hil.daemon.metrics import Metrics, MetricsServer
from hil.daemon.records import GatewayAlive
from hil.daemon.zenoh_session import RigSession
from hil.signals import Event

ALIVE_S: Final = 0.1
"""Interval of the heartbeat to control."""
AT_REST: Final = ("offline", "preparing", "parked", "ready")
"""States in which the end of control is nothing to worry about."""


def run_gateway(
    rig: RigFile,
    rig_text: str,
    sock: socket.socket,
    log: Log,
    options: GatewayOptions | None = None,
) -> int:
    """Run until control closes its end of `sock`. Returns 0, or 1 if control died in motion.

    RigInUse if the Zenoh endpoint is taken, ConfigError if it cannot be opened.
    """
    sys.setswitchinterval(0.001)  # the recorder's thread must not hold up cues for 5 ms
    return asyncio.run(Gateway(rig, rig_text, sock, log, options or GatewayOptions()).run())


class Gateway:
    """One rig's gateway; `run` does everything."""

    def __init__(
        self,
        rig: RigFile,
        rig_text: str,
        sock: socket.socket,
        log: Log,
        options: GatewayOptions,
    ) -> None:
        self._rig = rig
        self._log = log
        self._options = options
        self._channel = Channel(sock)
        self._metrics = Metrics(rig.name)
        folder = options.runs_folder or Path(rig.recording.folder)
        self._recording = Recording(folder, rig_text, rig, self._on_recording_end)

    async def run(self) -> int:
        """Serve until control closes its end; see `run_gateway`."""
        self._loop = asyncio.get_running_loop()
        self._done = asyncio.Event()
        try:
            session = RigSession(self._rig)
            try:
                return await self._serve(session)
            finally:
                session.close()
        finally:
            self._channel.close()

    async def _serve(self, session: RigSession) -> int:
        commands = PendingCommands(self._channel, self._options.command_timeout_s)
        self._events = Events(session, self._recording, self._metrics, self._log)
        parts = (self._channel, session, self._recording, self._metrics, self._events, commands)
        self._relay = Relay(self._rig, *parts)
        clients = Clients(self._rig, *parts)
        server = self._serve_metrics()
        try:
            session.declare(
                messages.schemas(self._rig.coordinates, self._rig.actuator_names),
                on_cue=clients.on_cue,
                on_query=clients.on_query,
                on_client=clients.on_client,
            )
            await self._say_ready()
            self._loop.add_reader(self._channel.fileno(), self._on_readable)
            self._handle_signals()
            await self._beat(clients)
            return self._farewell()
        finally:
            self._loop.remove_reader(self._channel.fileno())
            await clients.finish()
            await self._recording.close("the gateway has ended")
            if server is not None:
                server.close()

    def _serve_metrics(self) -> MetricsServer | None:
        port = self._options.metrics_port
        if port is None:
            return None
        server = MetricsServer(self._metrics.registry, port)
        where = f"metrics at http://127.0.0.1:{server.port}/metrics"
        self._events.say("info", "metrics_ready", where)
        return server

    async def _say_ready(self) -> None:
        listen = ", ".join(self._rig.zenoh.listen) or self._rig.zenoh.config or "nowhere"
        self._events.say("info", "gateway_ready", f"clients reach {self._rig.name} at {listen}")
        if self._options.is_recording:
            reply = await self._recording.start()
            self._events.say("info" if reply.ok else "warning", "recording", reply.message)

    def _handle_signals(self) -> None:
        """Ctrl-C and systemd reach both processes; control parks first, and all of that is recorded."""
        linger_s = control_s(self._rig)
        for number in (signal.SIGINT, signal.SIGTERM):
            with suppress(ValueError, RuntimeError):  # not on the main thread
                self._loop.add_signal_handler(
                    number, lambda: self._loop.call_later(linger_s, self._done.set)
                )

    async def _beat(self, clients: Clients) -> None:
        """Until the end: heartbeat to control, and a look at everybody."""
        while not self._done.is_set() and self._channel.is_open:
            now_s = time.monotonic()
            is_recording = self._recording.path is not None
            self._channel.send(GatewayAlive(now_s, is_recording))
            self._metrics.is_recording.set(is_recording)
            self._metrics.record_drops.set(self._recording.dropped)
            self._metrics.log_drops.set(self._log.dropped)
            self._events.watch()
            self._relay.watch(now_s)
            clients.watch()
            with suppress(TimeoutError):
                await asyncio.wait_for(self._done.wait(), ALIVE_S)

    def _on_readable(self) -> None:
        self._relay.on_readable()
        if not self._channel.is_open:
            self._done.set()

    def _farewell(self) -> int:
        """Pass on control's last words and say how it ended."""
        while self._relay.on_readable():
            pass
        if self._channel.is_open:
            self._events.say("warning", "gateway_leaves", "told to stop before control has ended")
            return 0
        last = self._relay.last_state
        state = last.state if last is not None else "offline"
        self._relay.publish_end()
        severity: Final = "info" if state in AT_REST else "fault"
        text = f"the control process has ended; the rig was {state}"
        self._events.say(severity, "control_gone", text)
        return 0 if state in AT_REST else 1

    def _on_recording_end(self, event: Event) -> None:
        """On the recorder's thread: a recording has ended by itself, the disk is full or failed."""
        with suppress(RuntimeError):  # the loop has ended meanwhile
            self._loop.call_soon_threadsafe(self._events.tell, event)
