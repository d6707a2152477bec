"""What the daemon does when a part of it is gone or hangs: real processes, a real hub, real time."""

from __future__ import annotations

import contextlib
import os
import signal
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from hil.runs import load_run
from tests.daemon.bench import Bench, arm, in_state, is_in, wait_for

pytestmark = pytest.mark.timeout(240)


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
        arm(client)
    again.send_signal(signal.SIGINT)
    assert again.wait(30.0) == 0
    killed = sorted(riding.runs.iterdir())[0]
    assert load_run(killed).damage is None, "the gateway outlives control and ends the recording"


def test_killing_the_gateway_parks_and_ends_the_daemon_with_an_error(riding):
    (gateway,) = children_of(riding.control.pid)
    os.kill(gateway, signal.SIGKILL)
    assert riding.control.wait(30.0) == 1
    assert "name=gateway_gone" in said(riding)
    (folder,) = riding.runs.iterdir()
    run = load_run(folder)
    assert run.table["t"].max() > 0.5  # all but the last second is there


def test_a_gateway_that_hangs_parks_the_rig_and_ends_the_daemon_with_an_error(riding):
    (gateway,) = children_of(riding.control.pid)
    os.kill(gateway, signal.SIGSTOP)
    assert riding.control.wait(60.0) == 1
    assert not Path(f"/proc/{gateway}").exists()
    assert "says nothing for 5 s: the rig parks and the daemon ends" in said(riding)


def test_a_gateway_that_never_comes_up_ends_the_daemon_and_is_named(bench):
    bench.simulate()
    bench.control = bench.daemon()
    wait_for(lambda: children_of(bench.control.pid))
    (gateway,) = children_of(bench.control.pid)
    os.kill(gateway, signal.SIGSTOP)
    assert bench.control.wait(60.0) == 1
    assert "the gateway process has not come up in 20 s" in said(bench)


def test_a_command_that_waited_while_control_hung_is_not_done(bench):
    """Who gave it is told after five seconds that nobody answered, and may stand beside the rig by then."""
    bench.simulate()
    bench.control = bench.daemon()
    with contextlib.closing(bench.client()) as client, ThreadPoolExecutor(1) as pool:
        in_state(client, "parked", "fault")
        bench.control.send_signal(signal.SIGSTOP)
        time.sleep(0.3)
        asked = pool.submit(client.command, "arm")
        time.sleep(3.0)
        bench.control.send_signal(signal.SIGCONT)
        reply = asked.result(10.0)
        assert not reply.ok
        assert "s late" in reply.message
        time.sleep(0.5)
        assert is_in(client, "parked", "fault", "emergency")


def said(bench: Bench) -> str:
    """What the daemon, which has ended, wrote."""
    bench.processes.remove(bench.control)
    return bench.control.communicate()[0]


def children_of(pid: int) -> list[int]:
    return [int(child) for child in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]
