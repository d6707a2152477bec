"""The gateway's end of Zenoh: what is declared on the network, with which quality of service.

Zenoh calls back on threads of its own. Here everything is handed to the asyncio loop, through an
inbox that is bounded: a client that floods the rig loses its own messages and nothing else.
"""

from __future__ import annotations

import asyncio
import json
import time
from collections import deque
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, Final

import zenoh

from hil.client import reason, zenoh_config
from hil.config import AnyRig
from hil.errors import ConfigError, RigInUse
from hil.messages import LARGEST_PAYLOAD

INBOX: Final = 512
"""Messages that may wait for the loop; more than the worst client sends while it writes a chunk."""

LEAVING_S: Final = 2.0
"""A taken endpoint may be that of the daemon before us, whose gateway still ends its recording."""


@dataclass(frozen=True, slots=True)
class Arrival:
    """A message as it came. `payload` is None where it was too long to be looked at."""

    payload: bytes | None
    size: int
    client: str
    received_s: float


class Inbox:
    """Carries values from Zenoh's threads to the loop; beyond its bound they are dropped."""

    def __init__(self, loop: asyncio.AbstractEventLoop, handle: Callable[[Any], None]) -> None:
        self._loop = loop
        self._handle = handle
        self._waiting: deque[Any] = deque()
        self.dropped = 0

    def put(self, value: Any) -> bool:
        """From any thread; False if too many wait already."""
        if len(self._waiting) >= INBOX:
            self.dropped += 1
            return False
        self._waiting.append(value)
        with suppress(RuntimeError):  # the loop has ended meanwhile
            self._loop.call_soon_threadsafe(self._drain)
        return True

    def _drain(self) -> None:
        while self._waiting:
            self._handle(self._waiting.popleft())


class RigSession:
    """One rig on Zenoh. Opened on the loop's thread; every handler is called on that thread."""

    def __init__(self, rig: AnyRig) -> None:
        """RigInUse if the endpoint is taken, ConfigError if it cannot be opened."""
        self._prefix = f"hil/{rig.name}"
        self._schemas: dict[str, bytes] = {}
        self._publishers: dict[str, Any] = {}
        self._session = _open(rig)
        self._declared: list[Any] = []
        self._inboxes: tuple[Inbox, ...] = ()

    @property
    def dropped(self) -> int:
        """Messages of clients that found no room in an inbox."""
        return sum(inbox.dropped for inbox in self._inboxes)

    def declare(
        self,
        schemas: Mapping[str, dict[str, Any]],
        *,
        on_cue: Callable[[Arrival], None],
        on_query: Callable[[zenoh.Query], None],
        on_client: Callable[[tuple[str, bool]], None],
    ) -> None:
        """Put everything on the network, the liveliness token last: who sees it finds the rest."""
        session, loop = self._session, asyncio.get_running_loop()
        self._cues = Inbox(loop, on_cue)
        self._queries = Inbox(loop, on_query)
        self._clients = Inbox(loop, on_client)
        self._inboxes = (self._cues, self._queries, self._clients)
        for name, schema in schemas.items():
            self._schemas[self.key(f"schema/{name}")] = json.dumps(schema).encode()
        self._declared += [
            session.declare_subscriber(self.key("cue"), self._on_cue),
            session.declare_queryable(self.key("command/*"), self._on_query),
            session.declare_queryable(self.key("schema/*"), self._on_schema),
            session.liveliness().declare_subscriber(
                self.key("client/*"), self._on_client, history=True
            ),
        ]
        for key, payload in self._schemas.items():
            session.put(key, payload, encoding=zenoh.Encoding.APPLICATION_JSON)
        self._declared.append(session.liveliness().declare_token(self.key("alive")))

    def key(self, tail: str) -> str:
        """Key expression `hil/<rig>/<tail>`."""
        return f"{self._prefix}/{tail}"

    def publish(self, tail: str, payload: bytes, *, is_stream: bool) -> None:
        """Publish JSON. Streams go first and unbatched; nothing here waits for a slow subscriber."""
        publisher = self._publishers.get(tail)
        if publisher is None:
            publisher = self._publishers[tail] = self._session.declare_publisher(
                self.key(tail),
                encoding=zenoh.Encoding.APPLICATION_JSON,
                congestion_control=zenoh.CongestionControl.DROP,
                priority=zenoh.Priority.REAL_TIME if is_stream else zenoh.Priority.DATA_HIGH,
                express=is_stream,
            )
        publisher.put(payload)

    def reply(self, query: zenoh.Query, payload: bytes) -> None:
        """Answer a command; a client that is gone meanwhile is no error."""
        with suppress(zenoh.ZError), query:
            query.reply(
                query.key_expr, payload, encoding=zenoh.Encoding.APPLICATION_JSON, express=True
            )

    def close(self) -> None:
        """Leave the network: the liveliness token goes first."""
        for declared in reversed(self._declared):
            with suppress(zenoh.ZError):
                declared.undeclare()
        self._declared = []
        self._session.close()

    def _on_cue(self, sample: zenoh.Sample) -> None:
        now_s = time.monotonic()
        size = len(sample.payload)
        name = sample.attachment.to_bytes() if sample.attachment is not None else b""
        client = client_identity(name, session_of(sample))
        payload = sample.payload.to_bytes() if size <= LARGEST_PAYLOAD else None
        self._cues.put(Arrival(payload, size, client, now_s))

    def _on_query(self, query: zenoh.Query) -> None:
        if not self._queries.put(query):
            with suppress(zenoh.ZError), query:
                query.reply_err("too many commands wait already")

    def _on_schema(self, query: zenoh.Query) -> None:
        with suppress(zenoh.ZError), query:
            for key, payload in self._schemas.items():
                if query.key_expr.intersects(key):
                    query.reply(key, payload, encoding=zenoh.Encoding.APPLICATION_JSON)

    def _on_client(self, sample: zenoh.Sample) -> None:
        name = str(sample.key_expr).rpartition("/")[2]
        self._clients.put((name, sample.kind == zenoh.SampleKind.PUT))


def session_of(message: zenoh.Sample | zenoh.Query) -> str:
    """The id of the session that says it sent `message`; empty where none does."""
    source = message.source_info
    return str(source.source_id.zid) if source is not None else ""


def client_identity(name: bytes, zid: str) -> str:
    """Who sent a cue, in at most 32 bytes: its name (attachment) and its session, as far as told.

    Two clients that tell neither cannot be told apart; both are "anonymous".
    """
    text = "".join(c for c in name[:64].decode(errors="replace") if c.isalnum() or c in "-_.")
    session = f"@{zid[:8]}" if zid else ""
    return f"{text[:20].encode()[:20].decode(errors='ignore')}{session}" or "anonymous"


def _open(rig: AnyRig) -> Any:
    settings = rig.zenoh
    where = ", ".join((*settings.listen, *settings.connect)) or settings.config
    given_up_s = time.monotonic() + LEAVING_S
    while True:
        try:
            config = zenoh_config("peer", settings.listen, settings.connect, settings.config)
            return zenoh.open(config)
        except zenoh.ZError as error:
            why = reason(error)
            if "in use" not in why:
                raise ConfigError(f"zenoh: {where} cannot be opened: {why}") from error
            if time.monotonic() > given_up_s:
                raise RigInUse(
                    f"zenoh.listen: {where} is taken: another daemon, or another program, listens "
                    "there; stop it or give this rig another endpoint"
                ) from error
        time.sleep(0.1)
