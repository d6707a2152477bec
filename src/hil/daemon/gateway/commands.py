"""Commands: what there is to ask, how it is put, and the answers that are still to come."""

from __future__ import annotations

import asyncio
from dataclasses import dataclass
from typing import Final

from hil.daemon.ipc import Channel
from hil.daemon.records import CommandRecord, ReplyRecord
from hil.daemon.wire import NAME_BYTES
from hil.daemon.zenoh_session import client_identity
from hil.errors import ProtocolError
from hil.messages import CommandReply, CommandRequest, decode


@dataclass(frozen=True, slots=True)
class Argument:
    """The one argument that a command may have."""

    name: str
    kind: type
    default: float | str | bool | None = None


COMMANDS: Final[dict[str, Argument | None]] = {
    "check": None,
    "arm": None,
    "disarm": None,
    "park": None,
    "stop": None,
    "finish": None,
    "reset": None,
    "gain": Argument("value", float),
    "record": Argument("on", bool, default=True),
    "object": Argument("request", str),
}
"""Every command of a rig. `record` is the gateway's own, the others are control's."""


@dataclass(frozen=True, slots=True)
class Command:
    """A command as a client put it."""

    name: str
    value: float | str | bool | None
    client: str

    @property
    def argument(self) -> str:
        """The value as text, for control."""
        return "" if self.value is None else str(self.value)


def parse_command(name: str, payload: bytes | None, zid: str = "") -> Command:
    """The command that a query of the session `zid` asks for; ProtocolError says what is wrong with it."""
    if name not in COMMANDS:
        raise ProtocolError(f"there is no command {name!r}; there are {', '.join(COMMANDS)}")
    request = decode(payload, CommandRequest) if payload else CommandRequest()
    argument = COMMANDS[name]
    unknown = request.arguments.keys() - {argument.name if argument else None}
    if unknown:
        takes = f"only {argument.name!r}" if argument else "no argument"
        raise ProtocolError(f"{name} takes {takes}, not {', '.join(sorted(unknown))}")
    value: float | str | bool | None = None
    if argument is not None:
        value = request.arguments.get(argument.name, argument.default)
        if not isinstance(value, argument.kind):
            raise ProtocolError(f"{name} needs {argument.name!r}, a {argument.kind.__name__}")
    if name == "finish":
        value = client_identity(request.client.encode(), zid)
    if isinstance(value, str) and len(value.encode()) > NAME_BYTES:
        raise ProtocolError(f"{name}: {value!r} is longer than {NAME_BYTES} bytes")
    return Command(name, value, request.client[:32])


class PendingCommands:
    """Commands that were given to control and wait for its reply."""

    def __init__(self, channel: Channel, timeout_s: float) -> None:
        self._channel = channel
        self._timeout_s = timeout_s
        self._waiting: dict[int, asyncio.Future[CommandReply]] = {}
        self._next_id = 1
        self.has_begun = False
        """Control has told a state: it runs. Before, it may compile its model for a minute."""

    async def ask(self, command: Command) -> CommandReply:
        """Give `command` to control and wait; every way in which that fails is a reply too."""
        command_id, self._next_id = self._next_id, self._next_id % (2**32 - 1) + 1
        future = asyncio.get_running_loop().create_future()
        self._waiting[command_id] = future
        try:
            if self._channel.send(CommandRecord(command_id, command.name, command.argument)):
                return CommandReply(False, "the control process cannot be reached")
            return await asyncio.wait_for(future, self._timeout_s)
        except TimeoutError:
            silent = f"did not answer within {self._timeout_s:g} s"
            if self.has_begun:
                return CommandReply(False, f"the control process {silent}")
            return CommandReply(
                False, f"the control process still starts and {silent}: give it once more later"
            )
        finally:
            del self._waiting[command_id]

    def resolve(self, reply: ReplyRecord) -> None:
        """Hand over control's reply; one that nobody waits for any more is dropped."""
        future = self._waiting.get(reply.command_id)
        if future is not None and not future.done():
            future.set_result(CommandReply(reply.ok, reply.text))

    def abandon(self, message: str) -> None:
        """Answer everything that waits: control is gone."""
        for future in self._waiting.values():
            if not future.done():
                future.set_result(CommandReply(False, message))
