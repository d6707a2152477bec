"""A simulated rig and its daemon as users run them: real processes, a real hub, real time."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

from hil.cli.demo import free_port
from hil.cli.options import rig_with
from hil.client import RigClient
from hil.errors import RigNotReached

PATIENCE_S = 90.0
RIDES = 5
"""So often a rig that a busy machine has stopped, as it should, is armed again."""


class Bench:
    """A simulated axis on a hub and its daemon, as processes of their own."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.bus = f"hub:{folder / 'bus.sock'}"
        self.endpoint = f"tcp/127.0.0.1:{free_port()}"
        self.runs = folder / "runs"
        self.file = folder / "axis.toml"
        self.file.write_text(rig_with("axis", patient=True)[1])
        self.processes: list[subprocess.Popen[str]] = []
        self.environment = {**os.environ, "XDG_RUNTIME_DIR": str(folder)}

    def start(self, *arguments: str) -> subprocess.Popen[str]:
        process = subprocess.Popen(
            [sys.executable, "-m", "hil", *arguments],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            cwd=self.folder,
            env=self.environment,
            start_new_session=True,
        )
        self.processes.append(process)
        return process

    def simulate(self) -> subprocess.Popen[str]:
        process = self.start("simulate", str(self.file), "--hub", "--can", self.bus)
        wait_for(lambda: (self.folder / "bus.sock").exists())
        return process

    def daemon(self) -> subprocess.Popen[str]:
        options = ("--can", self.bus, "--listen", self.endpoint, "--runs", str(self.runs))
        return self.start("run", str(self.file), *options)

    def client(self, rig: str = "axis") -> RigClient:
        deadline_s = time.monotonic() + PATIENCE_S
        while True:
            try:
                return RigClient(rig, self.endpoint, name="test").open()
            except RigNotReached:
                assert time.monotonic() < deadline_s, self.said()
                time.sleep(0.2)

    def said(self) -> str:
        for process in self.processes:
            process.kill()
        return "\n".join(process.communicate()[0] for process in self.processes)

    def end(self) -> None:
        for process in reversed(self.processes):
            if process.poll() is None:
                process.send_signal(signal.SIGINT)
                with contextlib.suppress(subprocess.TimeoutExpired):
                    process.wait(20.0)
            if process.poll() is None:
                os.killpg(process.pid, signal.SIGKILL)
            process.communicate()


def wait_for(condition: Callable[[], object], patience_s: float = PATIENCE_S) -> None:
    deadline_s = time.monotonic() + patience_s
    while not condition():
        assert time.monotonic() < deadline_s, "waited in vain"
        time.sleep(0.05)


def is_in(client: RigClient, *names: str) -> bool:
    state = client.state()
    return state is not None and state.state in names


def in_state(client: RigClient, *names: str) -> None:
    wait_for(lambda: is_in(client, *names))


def arm(client: RigClient) -> None:
    """A rig that a fault holds is reset first, as a person would, as often as that happens."""
    deadline_s = time.monotonic() + PATIENCE_S
    while time.monotonic() < deadline_s:
        in_state(client, "parked", "fault", "emergency")
        if not is_in(client, "parked"):
            client.command("reset")
        elif client.command("arm").ok:
            return
        time.sleep(0.1)
    raise AssertionError(f"not armed: {client.state()}")


def sway(client: RigClient, seconds: float) -> None:
    """20 mm forth in two seconds, and at once back."""
    for k in range(round(seconds * 50)):
        client.cue(position=0.02 * (k % 100) / 100.0)
        time.sleep(0.02)


def ride(client: RigClient, seconds: float = 1.0) -> None:
    """Arm and follow cues for so long; a rig that a busy machine stops, as it should, is armed again."""
    told = []
    for _ in range(RIDES):
        arm(client)
        sway(client, seconds)
        if is_in(client, "engaged"):
            return
        told.append(str(client.state()))
    raise AssertionError("\n".join(told))
