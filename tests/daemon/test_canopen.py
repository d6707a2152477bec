"""CANopen on a hub in real time: their master over our drive, our daemon over their drive."""

from __future__ import annotations

import contextlib
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from benchmarks.port_bus import PortBus

from hil.runs import load_run
from tests.daemon.bench import Bench, in_state, ride, wait_for
from tests.drives.cia402.on_wire import calm_rig, their_master_moves_it

ROOT = Path(__file__).parents[2]
pytestmark = pytest.mark.timeout(240)


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[Bench]:
    made = Bench(tmp_path)
    yield made
    made.end()


def hub(bench: Bench, *arguments: str) -> None:
    """A hub without anybody, or with a simulated rig."""
    if arguments:
        bench.start(*arguments)
    else:
        process = subprocess.Popen(
            [
                sys.executable,
                "-m",
                "hil.bus.hub",
                str(bench.folder / "bus.sock"),
                "--bitrate",
                "1000000",
            ],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            start_new_session=True,
        )
        bench.processes.append(process)
    wait_for(lambda: (bench.folder / "bus.sock").exists())


def test_canopens_master_takes_our_drive_to_force_and_moves_it(bench: Bench) -> None:
    rig = calm_rig(bench.folder)
    hub(bench, "simulate", str(rig), "--hub", "--can", bench.bus)
    seen = their_master_moves_it(PortBus(bench.bus))
    assert seen[-1] - seen[0] == pytest.approx(100_000, abs=500)


def test_our_daemon_rides_a_drive_written_with_durand(bench: Bench) -> None:
    rig = calm_rig(bench.folder)
    hub(bench)
    foreign = subprocess.Popen(
        [sys.executable, "-m", "tests.drives.cia402.on_wire", bench.bus],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        cwd=ROOT,
        start_new_session=True,
    )
    bench.processes.append(foreign)
    where = ("--can", bench.bus, "--listen", bench.endpoint, "--runs", str(bench.runs))
    daemon = bench.start("run", str(rig), *where)
    with contextlib.closing(bench.client("axis_canopen")) as client:
        ride(client, 3.0)
        in_state(client, "parked")
    daemon.terminate()
    assert daemon.wait(30.0) == 0
    (folder,) = bench.runs.iterdir()
    run = load_run(folder)
    assert foreign.poll() is None
    foreign.kill()
    engaged_s = [e.t_s for e in run.events if e.name == "rig_state" and e.text.endswith("engaged")]
    assert not [e for e in run.events if e.severity == "fault" and e.t_s > engaged_s[-1]]
    assert run.table["axis.position"].max() > 0.005
