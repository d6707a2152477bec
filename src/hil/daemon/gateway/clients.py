"""What clients ask, passed on to control: cues, commands, and who is there."""

from __future__ import annotations

import asyncio
from contextlib import suppress

import zenoh

from hil import messages
from hil.config import RigFile
from hil.daemon.cue_parts import split_cue
from hil.daemon.gateway.commands import Command, PendingCommands, parse_command
from hil.daemon.gateway.cues import CueInlet
from hil.daemon.gateway.events import Events
from hil.daemon.gateway.recording import Recording
from hil.daemon.ipc import Channel
from hil.daemon.metrics import Metrics
from hil.daemon.zenoh_session import Arrival, RigSession, session_of
from hil.errors import ProtocolError
from hil.messages import CommandReply


class Clients:
    """The way from clients to control. Its handlers run on the loop's thread."""

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
        self._channel = channel
        self._session = session
        self._recording = recording
        self._metrics = metrics
        self._events = events
        self._commands = commands
        self._inlet = CueInlet(rig.coordinates)
        self._here: set[str] = set()
        self._tasks: set[asyncio.Task[None]] = set()
        self._flooded = 0

    def on_cue(self, arrival: Arrival) -> None:
        """A message came on the cue key."""
        try:
            cue = self._inlet.accept(arrival)
        except ProtocolError as error:
            self._metrics.cue(is_accepted=False)
            self._events.complain("cue_refused", arrival.client, str(error))
            return
        self._metrics.cue(is_accepted=True)
        if self._channel.send(*split_cue(cue)) and self._channel.is_open:
            text = "control does not take cues fast enough"
            self._events.complain("cue_lost", arrival.client, text)
        self._recording.put(lambda recorder: recorder.cue(cue))

    def on_client(self, change: tuple[str, bool]) -> None:
        """A client showed its liveliness token, or it is gone."""
        name, is_here = change
        (self._here.add if is_here else self._here.discard)(name)
        self._metrics.clients.set(len(self._here))
        if is_here:
            self._events.repeated("info", "client_here", name, f"client {name} has come")
        else:
            self._events.repeated("info", "client_gone", name, f"client {name} has gone")

    def on_query(self, query: zenoh.Query) -> None:
        """A command came; it is answered when control has answered it."""
        task = asyncio.get_running_loop().create_task(self._answer(query))
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    def watch(self) -> None:
        """Report clients that send more than the loop can look at."""
        if self._session.dropped > self._flooded:
            lost = self._session.dropped - self._flooded
            self._flooded = self._session.dropped
            self._events.complain("messages_lost", "clients", f"{lost} messages came too fast")

    async def finish(self) -> None:
        """Answer every command that still waits: control is gone."""
        self._commands.abandon("the control process is gone")
        await asyncio.gather(*self._tasks)

    async def _answer(self, query: zenoh.Query) -> None:
        key = str(query.key_expr)
        if "*" in key:
            with suppress(zenoh.ZError), query:
                query.reply_err("a command is given to one key, without wildcards")
            return
        name, who = key.rpartition("/")[2], "a client"
        payload = query.payload.to_bytes() if query.payload is not None else None
        try:
            command = parse_command(name, payload, session_of(query))
        except ProtocolError as error:
            reply = CommandReply(False, str(error))
        else:
            who = command.client or who
            reply = await self._carry_out(command)
            self._metrics.command(name, ok=reply.ok)
        self._session.reply(query, messages.encode(reply))
        outcome = "command_done" if reply.ok else "command_refused"
        asked = f"{name[:32]} from {who}"
        self._events.repeated("info", outcome, asked, f"{asked}: {reply.message}")

    async def _carry_out(self, command: Command) -> CommandReply:
        if command.name != "record":
            return await self._commands.ask(command)
        if command.value:
            return await self._recording.start()
        return await self._recording.stop(f"command of {command.client or 'a client'}")
