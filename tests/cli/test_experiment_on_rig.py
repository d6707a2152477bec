"""Experiments and cues through a running daemon, with its processes, its bus and its network."""

import socket
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack

import pytest
from typer.testing import CliRunner

from hil.cli.app import app
from hil.client import RigClient
from hil.config import RigFile
from hil.configfile import load_rig, parse_settings, rig_toml
from hil.errors import CommandRefused, RigNotReached
from hil.identify.experiments import experiment_of
from hil.runs import load_run, read_cue_file

run = CliRunner().invoke
START_S = 60.0
"""A fresh checkout compiles the model first."""
STALE_S = 1.0


def reached(endpoint: str) -> RigClient:
    end_s = time.monotonic() + START_S
    while True:
        try:
            return RigClient("axis", endpoint, timeout_s=1.0).open()
        except RigNotReached:
            if time.monotonic() > end_s:
                raise
            time.sleep(0.2)


def armed(client: RigClient) -> None:
    end_s = time.monotonic() + START_S
    while not client.command("arm").ok and time.monotonic() < end_s:
        time.sleep(0.3)


@pytest.fixture(scope="module")
def daemon(tmp_path_factory):
    """Simulated rig and daemon of the axis; gives endpoint, rig file and folder of runs."""
    tmp_path = tmp_path_factory.mktemp("daemon")
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        endpoint = f"tcp/127.0.0.1:{free.getsockname()[1]}"
    patient = load_rig("axis").model_dump()
    patient["safety"].update(overrun_cycles=100, answer_timeout=1.0, drive_watchdog=1.0)
    patient["cue"]["stale"] = STALE_S  # a busy machine is not what is tested here
    rig = tmp_path / "patient.toml"
    rig.write_text(rig_toml(parse_settings(patient, RigFile, "axis")))
    bus, runs = f"hub:{tmp_path / 'bus.sock'}", tmp_path / "runs"
    hil = [sys.executable, "-m", "hil"]
    commands = (
        ["simulate", str(rig), "--hub", "--can", bus],
        ["run", str(rig), "--can", bus, "--listen", endpoint, "--runs", str(runs)],
    )
    with ExitStack() as stack:
        log = stack.enter_context((tmp_path / "log.txt").open("w"))
        for command in commands:
            process = subprocess.Popen([*hil, *command], stdout=log, stderr=log)
            stack.callback(process.wait, 30.0)
            stack.callback(process.terminate)
            end_s = time.monotonic() + START_S
            while not (tmp_path / "bus.sock").exists() and time.monotonic() < end_s:
                time.sleep(0.1)
        yield endpoint, rig, runs


def test_an_armed_rig_plays_an_experiment_and_parks(daemon):
    endpoint, rig, runs = daemon
    step = ["experiment", str(rig), "step", "--count", "1", "--hold", "0.3"]
    step += ["--endpoint", endpoint, "--runs", str(runs)]
    with reached(endpoint) as client:
        refused = run(app, step)
        assert isinstance(refused.exception, CommandRefused)
        assert "arm it first" in str(refused.exception)
        armed(client)
        result = run(app, step)
        assert result.exit_code == 0, result.exception
        assert next(client.states()).state == "parked"
    (folder,) = (f for f in runs.iterdir() if experiment_of(f) is not None)
    played = experiment_of(folder).played
    assert (played.on, played.endpoint) == ("rig", endpoint)
    kept = load_run(folder)
    motion = read_cue_file(folder / "experiment.csv").trajectory
    sent = kept.table[["t", "axis.setpoint"]].dropna()
    moving = sent["t"][sent["axis.setpoint"] > 0.005]
    designed = motion.t_s[motion.poses[:, 0] > 0.005]
    starts = (moving.iloc[0] - played.start_s, designed[0])
    assert starts[0] == pytest.approx(starts[1], abs=0.05)
    assert sent["axis.setpoint"].max() == pytest.approx(0.01, abs=2e-4)


def test_a_ride_needs_an_armed_rig_and_ends_when_the_rig_no_longer_follows(daemon):
    endpoint, rig, _ = daemon
    ride = ["cue", "ride", str(rig), "--endpoint", endpoint]
    with reached(endpoint) as client:
        assert client.command("disarm").ok
        refused = run(app, ride)
        assert isinstance(refused.exception, CommandRefused)
        assert "arm it first" in str(refused.exception)
        time.sleep(STALE_S)  # the last cue of another client would still drive the rig
        armed(client)
        with ThreadPoolExecutor() as pool:
            riding = pool.submit(run, app, ride)
            next(s for s in client.states() if s.state == "engaged")
            assert client.command("stop").ok
            ended = riding.result(timeout=20.0)
        assert isinstance(ended.exception, CommandRefused)
        assert "went to parking" in str(ended.exception)
        time.sleep(0.5)
        assert client.command("disarm").ok, "a stopped rig stays where it is"
