"""A connection to one rig: cues out, states and events in, commands with answers."""

from __future__ import annotations

import asyncio
import json
import math
import os
import re
import threading
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import Any, Final, Self

import zenoh

from hil import messages
from hil.client.feed import Feed, Feeds
from hil.client.session import reason, zenoh_config
from hil.errors import ProtocolError, RigNotReached
from hil.messages import CommandReply, CommandRequest, CueMessage, EventMessage, StateMessage

ENDPOINT: Final = "tcp/127.0.0.1:7447"
COMMAND_TIMEOUT_S: Final = 8.0
"""Longer than the daemon itself waits for an answer, so that its own sentence arrives."""


class RigClient:
    """A connection to one rig. All methods may be called from any thread."""

    def __init__(
        self,
        rig: str,
        endpoint: str | None = ENDPOINT,
        *,
        name: str | None = None,
        config: str | Path | None = None,
        timeout_s: float = 3.0,
    ) -> None:
        """`name` tells the rig who sends cues; `config` is a Zenoh JSON5 file, for TLS.

        With `endpoint` None the endpoints of that file are used. `timeout_s` is for connecting.
        ProtocolError if a name is none that fits into a key.
        """
        self.rig = _word(rig)
        self.name = _word(name or f"client-{os.getpid()}")
        self._timeout_s = timeout_s
        self.coordinates: tuple[str, ...] = ()
        """Names of the pose's coordinates, as the rig told on connection."""
        self._endpoint = endpoint
        self._config = config
        self._session: Any = None
        self._cue: Any = None
        self._held: list[Any] = []
        self._seq = 0
        self._numbering = threading.Lock()
        self._state: StateMessage | None = None
        self._states: Feeds[StateMessage] = Feeds()
        self._events: Feeds[EventMessage] = Feeds()

    def open(self) -> Self:
        """Connect; RigNotReached if no daemon of this rig answers, ConfigError for a bad `config`."""
        where = (self._endpoint,) if self._endpoint else ()
        try:
            config = zenoh_config("client", (), where, self._config, self._timeout_s)
            self._session = zenoh.open(config)
        except zenoh.ZError as error:
            raise RigNotReached(
                f"{self.rig}: no daemon at {self._endpoint or self._config}; is `hil run` up, or "
                f"`hil bicycle record` for a bicycle? ({reason(error)})"
            ) from error
        try:
            self._declare()
        except BaseException:
            self.close()
            raise
        return self

    def _declare(self) -> None:
        session = self._session
        self._held = [
            session.declare_subscriber(self._key("state"), self._on_state),
            session.declare_subscriber(self._key("event"), self._on_event),
            session.liveliness().declare_token(self._key(f"client/{self.name}")),
        ]
        self.coordinates = self._ask_coordinates()
        self._cue = session.declare_publisher(
            self._key("cue"),
            encoding=zenoh.Encoding.APPLICATION_JSON,
            congestion_control=zenoh.CongestionControl.DROP,
            priority=zenoh.Priority.REAL_TIME,
            express=True,
        )

    def _ask_coordinates(self) -> tuple[str, ...]:
        for reply in self._session.get(self._key("schema/cue"), timeout=self._timeout_s):
            if reply.ok is not None:
                schema = json.loads(reply.ok.payload.to_bytes())
                pose = schema["properties"]["poses"]["items"].get("properties", {})
                return tuple(key for key in pose if key != "dt")
        raise RigNotReached(f"{self.rig}: no rig of this name answers at {self._endpoint}")

    def close(self) -> None:
        """Disconnect; the rig parks once the cue is stale."""
        self._states.close()
        self._events.close()
        if self._session is not None:
            self._session.close()
        self._session = self._cue = None
        self._held = []

    def cue(self, **pose: float) -> int:
        """Ask for a pose now, coordinates by name (rad, m), neutral (0) where not named.

        Returns the cue's sequence number.
        """
        return self.cues([{"dt": 0.0, **pose}])

    def cues(self, poses: Sequence[Mapping[str, float]], t_s: float | None = None) -> int:
        """Ask for one or many poses, each with `dt`, s after `t_s` (now, on the monotonic clock).

        ProtocolError for a coordinate that the rig has not, and for a number that is none. Returns the
        sequence number.
        """
        if self._cue is None:
            raise RigNotReached(f"{self.rig}: the client is not connected")
        neutral = dict.fromkeys(self.coordinates, 0.0)
        for pose in poses:
            unknown = pose.keys() - neutral.keys() - {"dt"}
            if unknown:
                raise ProtocolError(
                    f"{self.rig} has no coordinate {', '.join(sorted(unknown))}; "
                    f"it has {', '.join(self.coordinates)}"
                )
            for name, value in pose.items():
                if not math.isfinite(value):
                    raise ProtocolError(f"{name} = {value}: a cue holds finite numbers only")
        filled = [{"dt": 0.0, **neutral, **pose} for pose in poses]
        with self._numbering:  # numbers and times leave in the order in which they were taken
            self._seq += 1
            now_s = time.monotonic() if t_s is None else t_s
            self._cue.put(
                messages.encode(CueMessage(self._seq, now_s, filled)),
                attachment=self.name,
                source_info=zenoh.SourceInfo(self._cue.id, self._seq % 2**32),
            )
            return self._seq

    def state(self) -> StateMessage | None:
        """The last state that arrived; None before the first."""
        return self._state

    def states(self, timeout_s: float | None = 2.0) -> Feed[StateMessage]:
        """Each state from now on; RigNotReached if none comes for `timeout_s`."""
        return self._states.new(f"states of {self.rig}", timeout_s)

    def events(self, timeout_s: float | None = None) -> Feed[EventMessage]:
        """Each event from now on; waits for as long as it takes unless told otherwise."""
        return self._events.new(f"events of {self.rig}", timeout_s)

    def command(self, name: str, **arguments: float | str | bool) -> CommandReply:
        """Give a command (`arm`, `disarm`, `park` ...) and wait for its answer.

        A rig that refuses answers with `ok` false and says why; RigNotReached if nobody answers,
        ProtocolError if `name` cannot be a command's.
        """
        if self._session is None:
            raise RigNotReached(f"{self.rig}: the client is not connected")
        replies = self._session.get(
            self._key(f"command/{_word(name)}"),
            payload=messages.encode(CommandRequest(self.name, arguments)),
            encoding=zenoh.Encoding.APPLICATION_JSON,
            timeout=COMMAND_TIMEOUT_S,
            priority=zenoh.Priority.INTERACTIVE_HIGH,
            source_info=zenoh.SourceInfo(self._cue.id, 0),  # whose `finish` it is
        )
        for reply in replies:
            if reply.ok is not None:
                return messages.decode(reply.ok.payload.to_bytes(), CommandReply)
            return CommandReply(False, reply.err.payload.to_bytes().decode(errors="replace"))
        raise RigNotReached(f"{self.rig}: nobody answered the command {name}")

    def is_alive(self) -> bool:
        """Whether a daemon of this rig is there now."""
        if self._session is None:
            return False
        replies = self._session.liveliness().get(self._key("alive"), timeout=1.0)
        return any(reply.ok is not None for reply in replies)

    def _key(self, tail: str) -> str:
        return f"hil/{self.rig}/{tail}"

    def _on_state(self, sample: zenoh.Sample) -> None:
        with suppress(ProtocolError):
            self._state = messages.decode(sample.payload.to_bytes(), StateMessage)
            self._states.put(self._state)

    def _on_event(self, sample: zenoh.Sample) -> None:
        with suppress(ProtocolError):
            self._events.put(messages.decode(sample.payload.to_bytes(), EventMessage))

    def __enter__(self) -> Self:
        return self.open()

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        tb: TracebackType | None,
    ) -> None:
        self.close()

    async def __aenter__(self) -> Self:
        return await asyncio.to_thread(self.open)

    async def __aexit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        tb: TracebackType | None,
    ) -> None:
        await asyncio.to_thread(self.close)


def _word(name: str) -> str:
    """`name`, if it can be one part of a key; else ProtocolError."""
    if re.fullmatch(r"[A-Za-z0-9_.-]+", name) is None:
        raise ProtocolError(f"{name!r} is no name: letters, digits, dots, dashes and underscores")
    return name
