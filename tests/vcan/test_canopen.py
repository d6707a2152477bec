"""CANopen over SocketCAN: their master over our drive, our daemon over their drive, two buses at once."""

from __future__ import annotations

import contextlib
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import can
import pytest

from hil.runs import load_run
from tests.daemon.bench import Bench
from tests.drives.cia402.on_wire import calm_rig, their_master_moves_it

from .wire import PATIENCE_S, URL, VCAN, Rider, engage, sway, wait_for

ROOT = Path(__file__).parents[2]
pytestmark = [pytest.mark.vcan, pytest.mark.timeout(400)]


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[Bench]:
    made = Bench(tmp_path)
    made.bus = URL
    yield made
    made.end()


def test_canopens_master_takes_our_drive_to_force_and_moves_it(bench: Bench) -> None:
    bench.start("simulate", str(calm_rig(bench.folder)), "--can", URL)
    seen = their_master_moves_it(can.Bus(interface="socketcan", channel=VCAN))
    assert seen[-1] - seen[0] == pytest.approx(100_000, abs=1000)


def test_our_daemon_rides_a_drive_written_with_durand(bench: Bench) -> None:
    rig = calm_rig(bench.folder)
    foreign = subprocess.Popen(
        [sys.executable, "-m", "tests.drives.cia402.on_wire", URL],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        cwd=ROOT,
        start_new_session=True,
    )
    bench.processes.append(foreign)
    where = ("--can", URL, "--listen", bench.endpoint, "--runs", str(bench.runs))
    daemon = bench.start("run", str(rig), *where)
    with contextlib.closing(bench.client("axis_canopen")) as client:
        with Rider(client, sway):
            engage(client)
            wait_for(lambda: abs(client.state().pose["position"]) > 0.005, 30.0)
        wait_for(lambda: client.state().state == "parked", 60.0)
    daemon.terminate()
    assert daemon.wait(PATIENCE_S) == 0
    (folder,) = bench.runs.iterdir()
    assert load_run(folder).table["axis.position"].abs().max() > 0.005
    assert foreign.poll() is None
