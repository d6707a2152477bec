"""How `hil` ends: by a signal as by Ctrl-C, and with a sentence where its output is not taken."""

import signal
import subprocess
import sys
from pathlib import Path

import pytest

from hil.cli.app import main


@pytest.fixture
def own_signal():
    """Whatever becomes of SIGTERM, the tests themselves do not end by it."""
    before = signal.signal(signal.SIGTERM, lambda number, frame: None)
    yield
    signal.signal(signal.SIGTERM, before)


@pytest.mark.parametrize("line", ["config show axis", "config schema", "--version"])
def test_an_output_that_a_full_disk_does_not_take_is_one_sentence(line):
    with Path("/dev/full").open("w") as full:
        done = subprocess.run(
            [sys.executable, "-m", "hil", *line.split()],
            stdout=full, stderr=subprocess.PIPE, text=True, check=False,
        )  # fmt: skip
    assert done.stderr == "the output cannot be written: No space left on device\n"
    assert done.returncode == 1


def test_a_fault_that_is_not_of_the_output_is_shown_whole(own_signal, monkeypatch):
    def command():
        raise OSError(2, "No such file or directory")

    monkeypatch.setattr("hil.cli.app.app", command)
    with pytest.raises(OSError, match="No such file"):
        main()


def test_sigterm_interrupts_as_ctrl_c_does(own_signal, monkeypatch):
    cleared = []

    def command():
        try:
            signal.raise_signal(signal.SIGTERM)
        finally:
            cleared.append(True)
        raise AssertionError("went on")

    monkeypatch.setattr("hil.cli.app.app", command)
    with pytest.raises(SystemExit) as left:
        main()
    assert left.value.code == 130
    assert cleared
