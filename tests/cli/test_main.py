"""How `hil` ends: by a signal as by Ctrl-C."""

import signal

import pytest

from hil.cli.app import main


@pytest.fixture
def own_signal():
    """Whatever becomes of SIGTERM, the tests themselves do not end by it."""
    before = signal.signal(signal.SIGTERM, lambda number, frame: None)
    yield
    signal.signal(signal.SIGTERM, before)


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
