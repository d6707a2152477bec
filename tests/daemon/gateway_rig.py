"""A gateway on an endpoint of its own, with the test in the place of the control process."""

from __future__ import annotations

import json
import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import zenoh

from hil.client import zenoh_config
from hil.config import RigFile
from hil.configfile import find_rig_file, load_rig
from hil.daemon.gateway.gateway import GatewayOptions, run_gateway
from hil.daemon.ipc import Channel, socket_pair
from hil.daemon.log import Log
from hil.daemon.records import (
    ActuatorState,
    CommandRecord,
    CueRecord,
    Record,
    ReplyRecord,
    StateRecord,
)

PATIENCE_S = 5.0


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def rig_at(port: int, tmp_path: Path, **zenoh_settings: Any) -> RigFile:
    rig = load_rig("motorcycle")
    settings = {"listen": (f"tcp/127.0.0.1:{port}",), **zenoh_settings}
    return rig.model_copy(
        update={
            "zenoh": rig.zenoh.model_copy(update=settings),
            "recording": rig.recording.model_copy(update={"folder": str(tmp_path / "runs")}),
        }
    )


def until(condition: Callable[[], Any], patience_s: float = PATIENCE_S) -> Any:
    """What `condition` gives once it is true; fails if it does not become so."""
    end = time.monotonic() + patience_s
    while not (value := condition()):
        assert time.monotonic() < end, "nothing happened"
        time.sleep(0.002)
    return value


class FakeControl:
    """The control end of the socket: collects what comes, answers commands as it is told."""

    def __init__(self, channel: Channel) -> None:
        self.channel = channel
        self.heard: list[Record] = []
        self.answer: Callable[[CommandRecord], ReplyRecord | None] = lambda command: ReplyRecord(
            command.command_id, True, f"{command.name} {command.argument}".strip()
        )
        self._end = threading.Event()
        self._thread = threading.Thread(target=self._serve)
        self._thread.start()

    def _serve(self) -> None:
        while not self._end.is_set():
            for record in self.channel.receive():
                self.heard.append(record)
                if isinstance(record, CommandRecord) and (reply := self.answer(record)):
                    self.channel.send(reply)
            time.sleep(0.001)

    def cues(self) -> list[CueRecord]:
        return [record for record in self.heard if isinstance(record, CueRecord)]

    def commands(self) -> list[CommandRecord]:
        return [record for record in self.heard if isinstance(record, CommandRecord)]

    def state(self, state: str = "parked", t_s: float | None = None, **more: Any) -> None:
        now_s = time.monotonic() if t_s is None else t_s
        actuators = (ActuatorState(0.6, 0.6, 0.0, 100.0, 0.01),) * 3
        pose = (0.0, 0.01, 0.02)
        record = StateRecord(now_s, state, pose, (0.0,) * 3, actuators, 0.001, **more)
        # What a full queue does is another test's matter.
        until(lambda: self.channel.send(record) == 0)

    def die(self) -> None:
        self._end.set()
        self._thread.join()
        self.channel.close()


class RunningGateway:
    """A gateway on a thread; `result` is what it returned or raised."""

    def __init__(
        self, rig: RigFile, options: GatewayOptions | None = None, log_fd: int = 2
    ) -> None:
        ours, theirs = socket_pair()
        self.rig = rig
        self.port = int(rig.zenoh.listen[0].rpartition(":")[2])
        self.endpoint = rig.zenoh.listen[0]
        self.control = FakeControl(Channel(ours))
        self.result: int | BaseException | None = None
        self._options = options
        self._log = Log(rig.name, log_fd)
        self._socket = theirs
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def _run(self) -> None:
        text = find_rig_file("motorcycle").read_text()
        try:
            self.result = run_gateway(self.rig, text, self._socket, self._log, self._options)
        except Exception as error:  # noqa: BLE001  (the test looks at it)
            self.result = error
        finally:
            self._socket.close()
            self._log.close()

    def wait_ready(self) -> None:
        until(lambda: self.control.heard or self.result is not None)
        assert self.result is None, self.result

    def close(self) -> None:
        self.control.die()
        self._thread.join(PATIENCE_S)
        assert not self._thread.is_alive()


@contextmanager
def gateway(
    tmp_path: Path,
    options: GatewayOptions | None = None,
    log_fd: int = 2,
    **zenoh_settings: Any,
) -> Iterator[RunningGateway]:
    running = RunningGateway(rig_at(free_port(), tmp_path, **zenoh_settings), options, log_fd)
    try:
        running.wait_ready()
        yield running
    finally:
        running.close()


class Plain:
    """A Zenoh client that knows nothing of hil: what any other language's client would do."""

    def __init__(self, endpoint: str, rig: str = "motorcycle", config: Any = None) -> None:
        self.session = zenoh.open(config or zenoh_config("client", (), (endpoint,)))
        self.rig = rig
        self.seen: dict[str, list[Any]] = {}
        self._held: list[Any] = []

    def subscribe(self, tail: str) -> list[Any]:
        """Payloads of `hil/<rig>/<tail>` as they come, decoded; the gateway knows of it on return."""
        found: list[Any] = []

        def keep(sample: zenoh.Sample) -> None:
            found.append(json.loads(sample.payload.to_bytes()))

        self._held.append(self.session.declare_subscriber(f"hil/{self.rig}/{tail}", keep))
        self.get("schema/state")  # what is asked after it is answered after it
        return found

    def put(self, tail: str, payload: bytes, **more: Any) -> None:
        self.session.put(f"hil/{self.rig}/{tail}", payload, **more)

    def cue(self, seq: int = 1, **more: Any) -> None:
        pose = {"dt": 0.0, "yaw": 0.0, "pitch": 0.0, "roll": 0.02}
        self.put("cue", json.dumps({"seq": seq, "t": 1.5, "poses": [pose]}).encode(), **more)

    def get(self, tail: str, payload: bytes | None = None) -> list[tuple[str, Any]]:
        """Replies as (key, decoded payload); an error reply has the key "error"."""
        replies = self.session.get(f"hil/{self.rig}/{tail}", payload=payload, timeout=PATIENCE_S)
        return [
            (str(reply.ok.key_expr), json.loads(reply.ok.payload.to_bytes()))
            if reply.ok
            else ("error", reply.err.payload.to_bytes().decode())
            for reply in replies
        ]

    def close(self) -> None:
        self.session.close()


@contextmanager
def plain(endpoint: str, **more: Any) -> Iterator[Plain]:
    client = Plain(endpoint, **more)
    try:
        yield client
    finally:
        client.close()
