"""The daemon as users run it: real processes, a real hub, real time."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import time

import pytest

from hil.cli.demo import free_port
from hil.runs import load_run
from tests.daemon.bench import PATIENCE_S, ride

pytestmark = pytest.mark.timeout(240)


@pytest.mark.parametrize("times", [1, 3])
def test_ctrl_c_parks_then_leaves_and_the_recording_is_whole(riding, times):
    """However often it is pressed: whoever is impatient does not make the rig fall."""
    for _ in range(times):
        riding.control.send_signal(signal.SIGINT)
        time.sleep(0.1)
    assert riding.control.wait(30.0) == 0, riding.said()
    (folder,) = riding.runs.iterdir()
    run = load_run(folder)
    assert run.damage is None
    states = [e.text for e in run.events if e.name == "rig_state"]
    assert states[-1].endswith("parked")
    assert {"axis.setpoint", "axis.position", "axis.force", "imu.gyro_x"} <= set(run.table.columns)


def test_a_rig_that_cannot_be_parked_at_the_end_is_cut_and_the_daemon_leaves_with_an_error(
    slow, riding
):
    riding.simulated.send_signal(signal.SIGSTOP)
    riding.control.send_signal(signal.SIGINT)
    assert riding.control.wait(30.0) == 1
    riding.simulated.send_signal(signal.SIGCONT)
    (folder,) = riding.runs.iterdir()
    assert "answers_lost" in [e.name for e in load_run(folder).events if e.severity == "fault"]


def test_a_second_daemon_of_the_same_rig_refuses_to_start(riding):
    where = ("--can", riding.bus, "--listen", "tcp/127.0.0.1:0")
    second = riding.start("run", str(riding.file), *where)
    assert second.wait(PATIENCE_S) == 2
    said = second.communicate()[0]
    assert str(riding.control.pid) in said
    riding.processes.remove(second)
    ride(riding.rig)  # nobody sent cues meanwhile: it has parked


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
