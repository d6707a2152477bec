"""What the tests on real SocketCAN share: the interface, its tools, and rigs on it as processes."""

from __future__ import annotations

import math
import os
import signal
import socket
import subprocess
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from hil.client import RigClient
from hil.configfile import find_rig_file
from hil.errors import RigNotReached
from tests.daemon.bench import Bench

VCAN = os.environ.get("HIL_VCAN", "vcan0")
URL = f"socketcan:{VCAN}"
BITRATE_BPS = 500_000
PATIENCE_S = 180.0
CYCLE_S = 0.02
SLOWER = {
    "\ncycle = 0.01\n": f"\ncycle = {CYCLE_S}\n",
    "\n[cue]\n": "\n[safety]\nanswer_timeout = 0.45\ndrive_watchdog = 1.0\noverrun_cycles = 20\n"
    "\n[cue]\nstale = 4.0\n",
}
"""What a rig file must be patient about in a guest: one CPU for daemon, gateway, rig and test, which all
stand still while the guest waits for a file of the host."""
DRIVE_WATCHDOG_MS = 1000
STARVED = ("overrun", "gateway_gone", "cue_stale")
"""Events of a guest that had no processor for too long, whatever the test does to the bus."""


def slower(name: str) -> str:
    """The text of a shipped rig file, as patient as a guest needs it."""
    text = find_rig_file(name).read_text()
    for there, patient in SLOWER.items():
        assert there in text
        text = text.replace(there, patient)
    return text


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
        self.file.write_text(slower(name))

    def end(self) -> None:
        """Ctrl-C to all of them, and what they said: pytest shows it where a test has failed."""
        for process in self.processes:
            if process.poll() is None:
                process.send_signal(signal.SIGINT)
        for process in self.processes:
            try:
                print(process.communicate(timeout=30.0)[0])
            except subprocess.TimeoutExpired:
                process.kill()
                print(process.communicate()[0])
        self.processes.clear()

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
        wait_for(lambda: is_listening(port) or self.control.poll() is not None)
        assert self.control.poll() is None, "the daemon has ended"
        deadline_s = time.monotonic() + PATIENCE_S
        while True:
            try:
                return RigClient(self.name, self.endpoint, name="test").open()
            except RigNotReached:  # it listens, and takes its time to answer on one busy CPU
                if self.control.poll() is not None or time.monotonic() > deadline_s:
                    raise


def is_listening(port: int) -> bool:
    """Whether somebody takes connections at `port` of loopback."""
    with socket.socket() as probe:
        probe.settimeout(1.0)
        return probe.connect_ex(("127.0.0.1", port)) == 0


def wait_for(condition: Callable[[], object], patience_s: float = PATIENCE_S) -> None:
    """Wait until `condition` holds."""
    deadline_s = time.monotonic() + patience_s
    while not condition():
        assert time.monotonic() < deadline_s, "waited in vain"
        time.sleep(0.05)


class Rider:
    """Streams cues to a rig from a thread of its own until it is left."""

    def __init__(self, client: RigClient, cue: Callable[[float], dict[str, float]]) -> None:
        self._client, self._cue = client, cue
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._ride)

    def __enter__(self) -> Rider:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._over.set()
        self._thread.join()

    def _ride(self) -> None:
        started_s = time.monotonic()
        while not self._over.wait(2 * CYCLE_S):
            self._client.cue(**self._cue(time.monotonic() - started_s))


def sway(t_s: float) -> dict[str, float]:
    """A cue for the axis: 8 mm to either side, once in four seconds.

    So slow that drives which fall silent are missed before the setpoint has left them behind.
    """
    return {"position": 0.008 * math.sin(2.0 * math.pi * 0.25 * t_s)}


def engage(client: RigClient) -> None:
    """Reset what is latched, arm, and wait until the rig follows the cues that a rider streams."""
    deadline_s = time.monotonic() + PATIENCE_S
    while (state := client.state()) is None or state.state != "engaged":
        if state is not None and state.state in ("fault", "emergency"):
            client.command("reset")
        elif state is not None and state.state == "parked":
            client.command("arm")
        assert time.monotonic() < deadline_s, (state, client.command("check"))
        time.sleep(0.1)
