"""Start and stop of a ride's recording over Zenoh: the command that the other rigs have, answered alike.

`hil/<rig>/command/record` with {"on": true} or {"on": false}; events go out at `hil/<rig>/event`. So
`hil command bicycle record on`, `RigClient` and any Zenoh client work without a CAN adapter of their own.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import zenoh

from hil import messages
from hil.bicycle.acquisition import Acquisition, Told
from hil.config import BicycleFile
from hil.daemon.gateway.commands import Command, parse_command
from hil.daemon.zenoh_session import Arrival, RigSession
from hil.errors import ProtocolError, RunError
from hil.messages import CommandReply, EventMessage

RECORD: Final = "record"


class RemoteControl:
    """An acquisition on Zenoh. Open it on the loop's thread; commands are carried out on that thread."""

    def __init__(
        self, rig: BicycleFile, acquisition: Acquisition, clock: Callable[[], float]
    ) -> None:
        """RigInUse if the endpoint is taken, ConfigError if it cannot be opened."""
        self._rig = rig
        self._acquisition = acquisition
        self._clock = clock
        self._session = RigSession(rig)

    def open(self) -> None:
        """Put the commands on the network."""
        self._session.declare(
            messages.schemas(), on_cue=_nobody_drives, on_query=self._on_query, on_client=_welcome
        )

    def close(self) -> None:
        """Leave it."""
        self._session.close()

    def hear(self, told: Told) -> None:
        """Publish what the acquisition tells, where it is an event."""
        event = told.event
        if event is None:
            return
        message = EventMessage(event.t_s, event.severity, event.name, event.text)
        self._session.publish("event", messages.encode(message), is_stream=False)

    def _on_query(self, query: zenoh.Query) -> None:
        payload = query.payload.to_bytes() if query.payload is not None else None
        try:
            command = parse_command(str(query.key_expr).rpartition("/")[2], payload)
            reply = self._done(command)
        except ProtocolError as error:
            reply = CommandReply(False, str(error))
        self._session.reply(query, messages.encode(reply))

    def _done(self, command: Command) -> CommandReply:
        if command.name != RECORD:
            raise ProtocolError(
                f"{self._rig.name} is ridden, not driven: of the commands it knows {RECORD} alone"
            )
        recording = self._acquisition
        if command.value:
            if recording.is_recording:
                return CommandReply(False, f"records already into {recording.paths[-1]}")
            try:
                recording.start(self._clock(), f"ride, started by {command.client or 'a client'}")
            except RunError as error:
                return CommandReply(False, f"not recording: {error}")
            return CommandReply(True, f"records into {recording.paths[-1]}")
        if not recording.is_recording:
            return CommandReply(False, "nothing is being recorded")
        recording.stop(self._clock(), f"stopped by {command.client or 'a client'}")
        return CommandReply(True, f"{recording.paths[-1]} is closed")


def _nobody_drives(arrival: Arrival) -> None:
    """A cue for a bicycle: there is nothing that could follow it."""


def _welcome(client: tuple[str, bool]) -> None:
    """Clients come and go: a bicycle keeps nothing for them."""
