"""How late the control process begins its cycles on this machine, beside a bare loop woken the same way.

The daemon runs as users run it: simulated rig behind a CAN hub, control process, gateway with recording, a
client that streams cues, each a process of its own; lateness is what the recorded states say, armed and
riding. At the 10 ms that the LUST drives allow, and at 1 ms with imagined drives. The bare loops (asyncio,
timerfd, no work) run once alone and once at the same time as the daemon, under the same load.
"""

from __future__ import annotations

import asyncio
import gc
import math
import multiprocessing
import os
import signal
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from multiprocessing.context import SpawnProcess
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.client import connected
from benchmarks.figure import Options, Table
from benchmarks.rigs import profiles, variant
from hil.bus.hub import Hub
from hil.bus.port import open_port
from hil.cli.demo import free_port
from hil.client import RigClient
from hil.config import RigFile
from hil.configfile import rig_toml
from hil.control.demo_ride import DemoRide
from hil.daemon.gateway.options import GatewayOptions
from hil.daemon.latency import bare_loop
from hil.daemon.realtime import PRIORITY, request_fifo
from hil.daemon.run import run_rig
from hil.drives.profile import LustProfile
from hil.runs import load_run
from hil.sim.rig import SimulatedRig
from hil.sim.serve import serve_until_signalled

EDGES_US = (20, 50, 100, 200, 500, 1000, 2000, 5000, 10000)
"""Upper edges of the histogram's classes, µs; the last class is open."""
PATIENCE_S = 90.0
Array = NDArray[np.float64]
Profiles = dict[str, LustProfile]


@dataclass(frozen=True, slots=True)
class Lateness:
    """Lateness of every wake of one loop, µs, and the periods it missed altogether."""

    period_s: float
    late_us: Array
    overruns: int
    engaged: float = math.nan
    """Share of the time in which a daemon's rig followed cues."""


# the bare loop


def measure_bare(period_s: float, duration_s: float) -> Lateness:
    """The bare loop with the garbage collector at rest, as in the control process."""
    gc.collect()
    gc.freeze()
    gc.disable()
    try:
        return Lateness(
            period_s, *asyncio.run(bare_loop(period_s, max(1, round(duration_s / period_s))))
        )
    finally:
        gc.enable()
        gc.unfreeze()


# the daemon


def axis_10ms() -> tuple[RigFile, Profiles]:
    """The one-axis bench as it ships."""
    return variant("axis"), profiles()


def motorcycle_10ms() -> tuple[RigFile, Profiles]:
    """The motorcycle platform as it ships."""
    return variant("motorcycle"), profiles()


def axis_1ms() -> tuple[RigFile, Profiles]:
    """The bench with imagined drives: answers ten times faster than LUST drives', finer encoders.

    Without IMU, at 1 Mbit/s, so that four frames fit into a cycle. At 1 ms the encoder noise of the
    shipped file would look like jumps of speed to the safety gate. An overrun parks later than usual:
    what is wanted here is lateness, also where it is bad.
    """
    timing = {
        "cycle": 0.001,
        "stagger": 0.0,
        "jitter": 0.0,
        "setpoint_delay": 0.0001,
        "answer_delay": 0.0001,
        "answer_jitter": 0.0,
        "position_loop": 0.00025,
    }
    rig = variant(
        "axis",
        bus=timing,
        can={"bitrate": 1_000_000},
        noise={"position": 1e-6},
        safety={"overrun_cycles": 100},
    )
    return rig.model_copy(update={"imu": None}), profiles(timing={"answer_wait": 0.0009})


def _be_rig(rig: RigFile, files: Profiles) -> None:
    asyncio.run(_serve(rig, SimulatedRig(rig, files)))


async def _serve(rig: RigFile, simulated: SimulatedRig) -> None:
    async with Hub(Path(rig.can.url.removeprefix("hub:")), rig.can.bitrate):
        port = open_port(f"{rig.can.url}?node=rig", bitrate_bps=rig.can.bitrate)
        try:
            request_fifo(PRIORITY - 10)
            await serve_until_signalled(simulated, port)
        finally:
            port.close()


def _be_daemon(rig: RigFile, files: Profiles) -> None:
    run_rig(rig, rig_toml(rig), files, GatewayOptions(is_recording=True))


@contextmanager
def running(rig: RigFile, files: Profiles, folder: Path) -> Iterator[RigClient]:
    """Simulated rig and daemon as processes of their own; a client of them."""
    bus, endpoint = folder / "bus.sock", f"tcp/127.0.0.1:{free_port()}"
    tables = {
        "can": rig.can.model_copy(update={"url": f"hub:{bus}"}),
        "zenoh": rig.zenoh.model_copy(update={"listen": (endpoint,)}),
        "recording": rig.recording.model_copy(update={"folder": str(folder / "runs")}),
    }
    placed = rig.model_copy(update=tables)
    with ExitStack() as stack:
        _start(stack, _be_rig, placed, files)
        _wait(bus.exists, "the hub")
        _start(stack, _be_daemon, placed, files)
        yield stack.enter_context(connected(rig.name, endpoint, PATIENCE_S))


def _start(stack: ExitStack, target: Callable[..., None], *arguments: object) -> None:
    process = multiprocessing.get_context("spawn").Process(target=target, args=arguments)
    process.start()
    stack.callback(_end, process)


def _end(process: SpawnProcess) -> None:
    """Ctrl-C, as a user does; the daemon parks first."""
    if process.is_alive() and process.pid is not None:
        os.kill(process.pid, signal.SIGINT)
    process.join(PATIENCE_S)
    if process.is_alive():
        process.kill()
        process.join()


def _wait(is_so: Callable[[], bool], what: str) -> None:
    deadline_s = time.monotonic() + PATIENCE_S
    while not is_so():
        if time.monotonic() > deadline_s:
            raise TimeoutError(f"{what} did not come up within {PATIENCE_S:g} s")
        time.sleep(0.05)


def _is_parked(client: RigClient) -> bool:
    state = client.state()
    return state is not None and state.state == "parked"


def measure_daemon(rig: RigFile, files: Profiles, ride_s: float) -> tuple[Lateness, Lateness]:
    """Lateness of the control process while it rides for `ride_s`, and of a bare loop meanwhile."""
    with tempfile.TemporaryDirectory(prefix="hil-late-") as scratch:
        folder = Path(scratch)
        with running(rig, files, folder) as client:
            _wait(lambda: _is_parked(client), "a parked rig")
            time.sleep(0.5)
            client.command("arm")  # where the machine is too busy even for that, `engaged` says so
            start_s = time.monotonic()
            bare = _ride_beside_bare_loop(client, rig, ride_s)
            end_s = time.monotonic()
        (run_folder,) = (folder / "runs").iterdir()
        run = load_run(run_folder)
    assert run.meta.recording is not None
    at_s = run.states["t"] + run.meta.recording.start_s
    ride = run.states[(at_s > start_s) & (at_s < end_s)]
    late_us = 1e6 * ride["lateness_s"].to_numpy()
    overruns = int(ride["overruns"].iloc[-1] - ride["overruns"].iloc[0])
    engaged = float((ride["state"] == "engaged").mean())
    return Lateness(rig.bus.cycle, late_us, overruns, engaged), bare


def _ride_beside_bare_loop(client: RigClient, rig: RigFile, ride_s: float) -> Lateness:
    spawn = multiprocessing.get_context("spawn")
    ours, theirs = spawn.Pipe()
    process = spawn.Process(target=_be_bare, args=(theirs, rig.bus.cycle, ride_s))
    process.start()
    ride, start_s = DemoRide(rig), time.monotonic()
    while not ours.poll():
        poses = [ride.pose(time.monotonic() - start_s + ahead) for ahead in (0.0, 0.02, 0.04, 0.08)]
        named = [dict(zip(rig.coordinates, pose, strict=True)) for pose in poses]
        client.cues([{"dt": dt, **n} for dt, n in zip((0.0, 0.02, 0.04, 0.08), named, strict=True)])
        time.sleep(0.02)
    result: Lateness = ours.recv()
    process.join()
    return result


def _be_bare(pipe: object, period_s: float, duration_s: float) -> None:
    request_fifo()
    pipe.send(measure_bare(period_s, duration_s))  # type: ignore[attr-defined]


# all of it


def measure(options: Options = Options()) -> list[Table]:  # noqa: B008 - a frozen value
    """Figures and histograms of every loop."""
    duration_s = 3.0 if options.quick else 30.0
    found = {
        "bare loop, 10 ms, alone": measure_bare(0.01, duration_s),
        "bare loop, 1 ms, alone": measure_bare(0.001, duration_s),
    }
    setups = {"axis, 10 ms": axis_10ms}
    if not options.quick:
        setups |= {"motorcycle, 10 ms": motorcycle_10ms, "axis, 1 ms": axis_1ms}
    for name, setup in setups.items():
        daemon, bare = measure_daemon(*setup(), duration_s)
        found |= {f"daemon, {name}": daemon, f"bare loop beside daemon, {name}": bare}
    policy = {os.SCHED_OTHER: "other", os.SCHED_FIFO: "fifo", os.SCHED_RR: "rr"}
    right = request_fifo()
    scheduling = policy.get(os.sched_getscheduler(0) & ~os.SCHED_RESET_ON_FORK, "unknown")
    note = (
        f"{os.cpu_count()} CPUs, load {os.getloadavg()[0]:.1f}, scheduling {scheduling}"
        f"{'' if right.is_granted else ' (no real-time rights)'}"
    )
    rows = {
        name: (r.late_us.size, *_percentiles(r), r.overruns, 100.0 * r.engaged)
        for name, r in found.items()
    }
    late = Table(
        "lateness, µs",
        ("wakes", "p50", "p99", "p99.9", "max", "periods missed", "engaged, %"),
        rows,
        note,
    )
    bounds = (-math.inf, *EDGES_US, math.inf)
    shares = {
        name: tuple((100.0 * np.histogram(r.late_us, bounds)[0] / r.late_us.size).tolist())
        for name, r in found.items()
    }
    edges = (*(f"< {edge}" for edge in EDGES_US), f">= {EDGES_US[-1]}")
    return [late, Table("share of wakes so late, µs, in %", edges, shares)]


def _percentiles(r: Lateness) -> tuple[float, ...]:
    return tuple(np.percentile(r.late_us, (50, 99, 99.9, 100)).tolist())
