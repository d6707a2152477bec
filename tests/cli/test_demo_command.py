"""`hil demo` ends, and says why, whatever becomes of its processes; none of them is real here."""

from __future__ import annotations

import itertools
import os
import signal
import sys
import threading
import time
from types import SimpleNamespace

import pytest
from typer.testing import CliRunner

from hil.cli import demo
from hil.cli.app import app
from hil.cli.options import rig_with
from hil.configfile import load_rig
from hil.errors import HilError
from hil.messages import StateMessage
from hil.runs import Recorder

run = CliRunner().invoke


class Client:
    """A rig that is parked once and then ready for ever: no cue ever comes."""

    def __enter__(self):
        return self

    def __exit__(self, *_):
        pass

    def states(self):
        for k in itertools.count():
            state = "parked" if k < 2 else "ready"
            yield StateMessage(0.01 * k, state, {}, {}, {}, 0.0, "")

    def events(self):
        return SimpleNamespace(waiting=list)

    def command(self, name):
        return SimpleNamespace(ok=True, message=name)


@pytest.fixture
def cast(tmp_path, monkeypatch):
    """A cast on that rig; each process is the Python program that the dictionary has for its name."""
    programs = {}
    popen = demo.subprocess.Popen

    def start(command, **how):
        return popen([sys.executable, "-c", programs[command[3]]], **how)

    monkeypatch.setattr(demo.subprocess, "Popen", start)
    monkeypatch.setattr(demo.Cast, "_client", lambda _: Client())
    rig = load_rig("axis")
    return demo.Cast(rig, tmp_path / "axis.toml", tmp_path, 0), programs


@pytest.mark.timeout(60)
def test_a_ride_that_fails_ends_the_demo_with_what_it_said(cast):
    cast, programs = cast
    programs["cue"] = "import sys; sys.exit('ride.csv: no such file')"
    with pytest.raises(
        HilError, match=r"`hil cue` .* exit code 1; it said:\nride.csv: no such file$"
    ):
        cast.play(["play", "axis.toml", "ride.csv"])


@pytest.mark.parametrize(
    ("content", "sentence"),
    [
        (None, "no such file"),
        ("t,position\n0,0\n1,9\n", "position goes to 9"),
        ("t,y\n0,0\n1,0\n", "moves y"),
    ],
)
def test_a_cue_file_is_refused_before_anything_starts(tmp_path, monkeypatch, content, sentence):
    monkeypatch.setattr(demo.subprocess, "Popen", None)
    path = tmp_path / "ride.csv"
    if content is not None:
        path.write_text(content)
    result = run(app, ["demo", "axis", "--cue", str(path), "--runs", str(tmp_path / "runs")])
    assert isinstance(result.exception, HilError)
    assert str(path) in str(result.exception)
    assert sentence in str(result.exception)
    assert not (tmp_path / "runs").exists()


WAITS = "import signal, time; signal.signal(signal.SIGINT, signal.{}); print(flush=True); time.sleep(60)"


@pytest.fixture
def heeded(number):
    """A signal that whoever runs the tests may ignore (nohup), which the demo would leave so."""
    before = signal.signal(number, signal.SIG_DFL)
    yield number
    signal.signal(number, before)


@pytest.mark.timeout(60)
@pytest.mark.parametrize("is_stubborn", [False, True])
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
def test_a_demo_that_is_told_to_end_leaves_no_process(cast, tmp_path, heeded, is_stubborn):
    cast, programs = cast
    programs["simulate"] = WAITS.format("default_int_handler")
    programs["run"] = WAITS.format("SIG_IGN" if is_stubborn else "default_int_handler")
    (tmp_path / "bus.sock").touch()
    again = threading.Timer(0.5, os.kill, (os.getpid(), heeded))

    def told():
        assert signal.getsignal(heeded) is signal.default_int_handler
        while not all((tmp_path / f"{name}.txt").read_text() for name in programs):
            time.sleep(0.01)
        if is_stubborn:
            again.start()
        signal.raise_signal(heeded)

    with pytest.raises(KeyboardInterrupt), demo.ended_as_by_ctrl_c(), cast:
        told()
    assert all(process.returncode is not None for process in cast._processes.values())


def test_a_signal_that_was_ignored_stays_ignored():
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with demo.ended_as_by_ctrl_c():
            os.kill(os.getpid(), signal.SIGHUP)
        assert signal.getsignal(signal.SIGHUP) is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGHUP, before)


def test_of_two_demos_into_one_folder_each_reports_its_own(tmp_path):
    rig, _ = rig_with("axis")
    (tmp_path / "runs").mkdir()
    casts = []
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        casts.append(demo.Cast(rig, tmp_path / name / "axis.toml", tmp_path / "runs", 0))
    (tmp_path / "a" / "run.txt").write_text("no bus")
    with pytest.raises(HilError, match=r"the daemon left no recording in .*; it said:\nno bus"):
        casts[0].recording()
    made = {}
    for name in ("b", "a"):
        own, text = rig_with("axis", can=f"hub:{tmp_path / name / 'bus.sock'}")
        recorder = Recorder(tmp_path / "runs", text, own, 0.0, reserve_bytes=0)
        recorder.close()
        made[name] = recorder.path
    (tmp_path / "runs" / "zz no run").mkdir()
    assert [cast.recording() for cast in casts] == [made["a"], made["b"]]
