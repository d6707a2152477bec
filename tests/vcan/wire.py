"""What the tests on real SocketCAN share: the interface, its tools, and rigs on it as processes."""

from __future__ import annotations

import os
import socket
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from hil.client import RigClient
from hil.configfile import find_rig_file
from hil.messages import StateMessage
from tests.daemon.test_processes import PATIENCE_S, Bench, in_state, wait_for

VCAN = os.environ.get("HIL_VCAN", "vcan0")
URL = f"socketcan:{VCAN}"
BITRATE_BPS = 500_000
CYCLE_S = 0.02
"""Twice the rig files' bus cycle: a guest has one slow CPU for daemon, gateway, rig and test."""

__all__ = [
    "BITRATE_BPS",
    "CYCLE_S",
    "PATIENCE_S",
    "URL",
    "VCAN",
    "RigOnWire",
    "in_state",
    "wait_for",
]


def require_interface() -> None:
    """Skip where there is no interface for tests."""
    if not Path(f"/sys/class/net/{VCAN}").exists():
        pytest.skip(f"needs a SocketCAN interface {VCAN} of its own: `make test-vcan` makes one")


def ip(*arguments: str) -> None:
    """`ip` of iproute2."""
    subprocess.run(["ip", *arguments], check=True)


def tc(*arguments: str) -> None:
    """`tc` of iproute2."""
    subprocess.run(["tc", *arguments], check=True)


def stop_the_queue(interface: str = VCAN) -> None:
    """Let the interface's queue fill up: after some frames, sending fails with ENOBUFS.

    A vcan has no bit time and so no queue that fills; a token bucket that is all but dry has.
    """
    tc(*f"qdisc add dev {interface} root tbf rate 8bit burst 32b limit 160".split())


@contextmanager
def raw_socket(interface: str = VCAN) -> Iterator[socket.socket]:
    """A bare socket on the interface, for what a port would not send."""
    with socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW) as sock:
        sock.bind((interface,))
        yield sock


class RigOnWire(Bench):
    """A simulated rig and its daemon on the interface, as processes of their own."""

    def __init__(self, folder: Path, name: str) -> None:
        super().__init__(folder)
        self.name = name
        self.bus = URL
        self.file = folder / f"{name}.toml"
        text = find_rig_file(name).read_text()
        assert "\ncycle = 0.01\n" in text
        self.file.write_text(text.replace("\ncycle = 0.01\n", f"\ncycle = {CYCLE_S}\n"))

    def simulate(self) -> subprocess.Popen[str]:
        self.simulated = self.start("simulate", str(self.file), "--can", URL)
        return self.simulated

    def daemon(self, *options: str) -> subprocess.Popen[str]:
        where = ("--can", URL, "--listen", self.endpoint, "--runs", str(self.runs))
        self.control = self.start("run", str(self.file), *where, *options)
        return self.control

    def client(self) -> RigClient:
        # One that comes before the daemon's endpoint is there waits seconds for its next try.
        port = int(self.endpoint.rpartition(":")[2])
        wait_for(lambda: is_listening(port))
        return RigClient(self.name, self.endpoint, name="test").open()


def is_listening(port: int) -> bool:
    """Whether somebody takes connections at `port` of loopback."""
    with socket.socket() as probe:
        probe.settimeout(1.0)
        return probe.connect_ex(("127.0.0.1", port)) == 0


def ride(
    client: RigClient,
    until: Callable[[StateMessage], bool],
    cue: Callable[[float], dict[str, float]],
    patience_s: float = PATIENCE_S,
) -> StateMessage:
    """Stream `cue(seconds)` until a state is as wished; returns that state."""
    started_s = time.monotonic()
    while True:
        elapsed_s = time.monotonic() - started_s
        client.cue(**cue(elapsed_s))
        state = client.state()
        if state is not None and until(state):
            return state
        assert elapsed_s < patience_s, f"waited in vain; the rig says {state}"
        time.sleep(2 * CYCLE_S)
