"""The daemon as users run it: real processes, a real hub, real time."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from hil.cli.demo import free_port
from hil.client import RigClient
from hil.errors import RigNotReached
from hil.runs import load_run

PATIENCE_S = 60.0
pytestmark = pytest.mark.timeout(240)


class Bench:
    """A simulated axis on a hub and its daemon, as processes of their own."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.bus = f"hub:{folder / 'bus.sock'}"
        self.endpoint = f"tcp/127.0.0.1:{free_port()}"
        self.runs = folder / "runs"
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
        process = self.start("simulate", "axis", "--hub", "--can", self.bus)
        wait_for(lambda: (self.folder / "bus.sock").exists())
        return process

    def daemon(self) -> subprocess.Popen[str]:
        options = ("--can", self.bus, "--listen", self.endpoint, "--runs", str(self.runs))
        return self.start("run", "axis", *options)

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


def wait_for(condition, patience_s: float = PATIENCE_S) -> None:
    deadline_s = time.monotonic() + patience_s
    while not condition():
        assert time.monotonic() < deadline_s, "waited in vain"
        time.sleep(0.05)


def in_state(client: RigClient, *names: str) -> None:
    wait_for(lambda: (state := client.state()) is not None and state.state in names)


def sway(client: RigClient, seconds: float) -> None:
    for k in range(round(seconds * 50)):
        client.cue(position=0.02 * (k % 100) / 100.0)
        time.sleep(0.02)


@pytest.fixture
def bench(tmp_path):
    made = Bench(tmp_path)
    yield made
    made.end()


@pytest.fixture
def riding(bench):
    """The bench with an armed rig that follows cues."""
    bench.simulated = bench.simulate()
    bench.control = bench.daemon()
    with contextlib.closing(bench.client()) as client:
        in_state(client, "parked")
        assert client.command("arm").ok
        sway(client, 1.0)
        assert client.state().state == "engaged"
        bench.rig = client
        yield bench


def test_ctrl_c_parks_then_leaves_and_the_recording_is_whole(riding):
    riding.control.send_signal(signal.SIGINT)
    assert riding.control.wait(30.0) == 0, riding.said()
    (folder,) = riding.runs.iterdir()
    run = load_run(folder)
    assert run.damage is None
    states = [e.text for e in run.events if e.name == "rig_state"]
    assert states[-1].endswith("parked")
    assert {"axis.setpoint", "axis.position", "axis.force", "imu.gyro_x"} <= set(run.table.columns)


def test_a_second_daemon_of_the_same_rig_refuses_to_start(riding):
    second = riding.start("run", "axis", "--can", riding.bus, "--listen", "tcp/127.0.0.1:0")
    assert second.wait(PATIENCE_S) == 2
    said = second.communicate()[0]
    assert str(riding.control.pid) in said
    riding.processes.remove(second)
    assert riding.rig.state().state in ("parking", "parked")  # nobody sent cues meanwhile
    assert riding.rig.command("arm").ok
    sway(riding.rig, 0.5)
    assert riding.rig.state().state == "engaged"


def test_killing_control_stops_the_drives_and_a_new_daemon_comes_up_disarmed(riding):
    (gateway,) = children_of(riding.control.pid)
    riding.control.kill()
    riding.control.wait()
    wait_for(lambda: not Path(f"/proc/{gateway}").exists())
    again = riding.daemon()
    with contextlib.closing(riding.client()) as client:
        in_state(client, "parked", "fault")
        if client.state().state == "fault":
            assert "drive_error: axis" in client.state().fault
            assert client.command("reset").ok
            in_state(client, "parked")
        assert client.command("arm").ok
    again.send_signal(signal.SIGINT)
    assert again.wait(30.0) == 0
    killed = sorted(riding.runs.iterdir())[0]
    assert load_run(killed).damage is None, "the gateway outlives control and ends the recording"


def test_killing_the_gateway_parks_and_ends_the_daemon_with_an_error(riding):
    (gateway,) = children_of(riding.control.pid)
    os.kill(gateway, signal.SIGKILL)
    assert riding.control.wait(30.0) == 1
    (folder,) = riding.runs.iterdir()
    run = load_run(folder)
    assert run.table["t"].max() > 0.5  # all but the last second is there


def test_a_gateway_that_hangs_parks_the_rig_and_ends_the_daemon_with_an_error(riding):
    (gateway,) = children_of(riding.control.pid)
    os.kill(gateway, signal.SIGSTOP)
    assert riding.control.wait(60.0) == 1
    assert not Path(f"/proc/{gateway}").exists()


def children_of(pid: int) -> list[int]:
    return [int(child) for child in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]


def test_command_watch_and_ride_speak_to_a_running_rig(riding):
    def hil(*arguments):
        return subprocess.run(
            [sys.executable, "-m", "hil", *arguments, "-e", riding.endpoint],
            capture_output=True,
            text=True,
            timeout=PATIENCE_S,
            check=False,
        )

    refused = hil("command", "axis", "reset")
    assert (refused.returncode, refused.stdout) == (1, "")
    assert "no fault" in refused.stderr
    done = hil("command", "axis", "gain", "0.5", "--json")
    assert json.loads(done.stdout)["ok"]
    told = hil("drive", "read", "axis", "axis", "position gain", "--can", riding.bus, "--json")
    assert json.loads(told.stdout) == {"name": "position gain", "value": 80.0}, told.stderr
    held = hil("drive", "write", "axis", "axis", "watchdog", "0.2", "--can", riding.bus)
    assert held.returncode != 0
    assert "hil itself writes" in held.stderr
    lines = hil("watch", "axis", "--json", "--seconds", "0.5").stdout.splitlines()
    assert len(lines) >= 20
    assert json.loads(lines[-1])["actuators"]["axis"]["age_s"] < 0.1


def test_without_a_daemon_a_client_is_told_what_to_do():
    asked = subprocess.run(
        [
            sys.executable,
            "-m",
            "hil",
            "command",
            "axis",
            "arm",
            "-e",
            f"tcp/127.0.0.1:{free_port()}",
        ],
        capture_output=True,
        text=True,
        timeout=PATIENCE_S,
        check=False,
    )
    assert asked.returncode == 2
    assert "hil run" in asked.stderr


def test_a_bus_that_is_not_there_is_one_sentence(tmp_path):
    asked = subprocess.run(
        [sys.executable, "-m", "hil", "run", "axis", "--can", f"hub:{tmp_path / 'none.sock'}"],
        capture_output=True,
        text=True,
        timeout=PATIENCE_S,
        check=False,
        cwd=tmp_path,
    )
    assert asked.returncode == 2
    assert "none.sock" in asked.stderr
    assert "Traceback" not in asked.stderr


def test_the_demo_rides_and_reports(tmp_path):
    asked = subprocess.run(
        [sys.executable, "-m", "hil", "demo", "axis", "--seconds", "3"],
        capture_output=True,
        text=True,
        timeout=200,
        check=False,
        cwd=tmp_path,
        env={**os.environ, "XDG_RUNTIME_DIR": str(tmp_path)},
    )
    assert asked.returncode == 0, asked.stderr
    (folder,) = (tmp_path / "runs").iterdir()
    assert (folder / "report.html").stat().st_size > 10**6
    assert len(asked.stdout.splitlines()) == 11


def test_the_fast_demo_is_the_same_every_time(tmp_path):
    for name in ("a", "b"):
        subprocess.run(
            [
                sys.executable,
                "-m",
                "hil",
                "demo",
                "axis",
                "--fast",
                "--seconds",
                "2",
                "--runs",
                name,
            ],
            check=True,
            timeout=PATIENCE_S,
            capture_output=True,
            cwd=tmp_path,
        )
    (a,), (b,) = (tmp_path / "a").iterdir(), (tmp_path / "b").iterdir()
    assert (a / "can.log").read_text().splitlines() == (b / "can.log").read_text().splitlines()
    assert load_run(a).table.equals(load_run(b).table)
