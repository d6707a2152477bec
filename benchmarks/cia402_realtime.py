"""Six axes in real time: our daemon, whole, and the `canopen` package's threaded master, at the same drives.

The daemon runs as users run it: control process with real-time rights, gateway with recording, a client that
streams cues. `canopen`'s master has the same rights and does a part of the job: its periodic tasks send SYNC
and six targets, its callbacks take six answers; it shapes, checks and records nothing. Both are timed at the
drives (`benchmarks.cia402_drives`), which are ideal, so that simulating them takes nothing from the masters.
"""

from __future__ import annotations

import math
import multiprocessing
import os
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import partial
from multiprocessing.connection import Connection
from pathlib import Path

import canopen
import numpy as np

from benchmarks.cia402_drives import Array, Seen, be_drives
from benchmarks.client import connected
from benchmarks.figure import Cell, Table
from benchmarks.parts import Part
from benchmarks.port_bus import PortBus
from benchmarks.rigs import variant
from hil.cli.demo import free_port
from hil.client import RigClient
from hil.config import RigFile
from hil.configfile import data_folder, rig_toml
from hil.control.demo_ride import DemoRide
from hil.daemon.gateway.options import GatewayOptions
from hil.daemon.realtime import PRIORITY, request_precedence
from hil.daemon.run import run_rig
from hil.drivefiles import load_profiles
from hil.errors import CommandRefused

PATIENCE_S = 90.0
AHEAD_S = (0.0, 0.02, 0.04, 0.08)
COLUMNS = (
    *("cycles", "late p50, µs", "p99", "p99.9", "max", "cycles missed", "setpoints missed"),
    *("SYNC to last setpoint p50, µs", "p99", "control, % of a CPU", "gateway, %", "state"),
)


def rig_at(cycle_s: float) -> RigFile:
    """The hexapod at this cycle, without IMU: the bench has none."""
    timing = {"cycle": cycle_s, "setpoint_delay": cycle_s + 0.00015}
    safety = {"overrun_cycles": round(0.02 / cycle_s)}
    patient = {"stale": 2.0}  # a client that others keep from running is not what is timed
    return variant("stewart_canopen", bus=timing, cue=patient, safety=safety).model_copy(
        update={"imu": None}
    )


@contextmanager
def drives(rig: RigFile, folder: Path) -> Iterator[tuple[RigFile, Connection]]:
    """The rig file with the bench's sockets, and the line to the bench."""
    paths = [folder / f"bus{k}.sock" for k in range(len(rig.can.urls))]
    further = tuple(
        f.model_copy(update={"url": f"hub:{p}"})
        for f, p in zip(rig.can.further, paths[1:], strict=True)
    )
    can_table = rig.can.model_copy(update={"url": f"hub:{paths[0]}", "further": further})
    placed = rig.model_copy(update={"can": can_table})
    spawn = multiprocessing.get_context("spawn")
    ours, theirs = spawn.Pipe()
    process = spawn.Process(target=be_drives, args=(placed, load_profiles(rig), paths, theirs))
    process.start()
    try:
        if not ours.poll(PATIENCE_S):
            raise TimeoutError("the bench does not start")
        ours.recv()
        yield placed, ours
    finally:
        process.terminate()
        process.join()


# our daemon


def _be_daemon(rig: RigFile) -> None:
    run_rig(rig, rig_toml(rig), load_profiles(rig), GatewayOptions(is_recording=True))


def ours(cycle_s: float, seconds: float) -> tuple[Cell, ...]:
    """The daemon riding for `seconds`."""
    with tempfile.TemporaryDirectory(prefix="hil-cia402-") as scratch:
        folder = Path(scratch)
        endpoint = f"tcp/127.0.0.1:{free_port()}"
        with drives(rig_at(cycle_s), folder) as (rig, line):
            tables = {
                "zenoh": rig.zenoh.model_copy(update={"listen": (endpoint,)}),
                "recording": rig.recording.model_copy(update={"folder": str(folder / "runs")}),
            }
            placed = rig.model_copy(update=tables)
            daemon = multiprocessing.get_context("spawn").Process(target=_be_daemon, args=(placed,))
            daemon.start()
            assert daemon.pid is not None
            try:
                with connected(rig.name, endpoint, PATIENCE_S) as client:
                    _until(lambda: _state(client) == "parked")
                    time.sleep(0.5)
                    with suppress(CommandRefused):
                        client.command("arm")
                    start_s, spent = time.monotonic(), _spent_s(daemon.pid)
                    _stream(client, rig, seconds)
                    end_s, after = time.monotonic(), _spent_s(daemon.pid)
                    state = _state(client)
                line.send("end")
                seen: Seen = line.recv()
            finally:
                for _ in range(2):  # the second time it leaves at once: its drives are gone
                    daemon.terminate()
                    daemon.join(2.0)
                daemon.join(PATIENCE_S)
                daemon.kill()
    shares = [100.0 * (b - a) / (end_s - start_s) for a, b in zip(spent, after, strict=True)]
    return (*_figures(seen, cycle_s, start_s + 3.0, end_s), *shares, state)


def _state(client: RigClient) -> str:
    state = client.state()
    return "unknown" if state is None else state.state


def _until(is_so: Callable[[], bool]) -> None:
    deadline_s = time.monotonic() + PATIENCE_S
    while not is_so():
        if time.monotonic() > deadline_s:
            raise TimeoutError("the rig is not parked")
        time.sleep(0.05)


def _stream(client: RigClient, rig: RigFile, seconds: float) -> None:
    ride, start_s = DemoRide(rig), time.monotonic()
    while (now_s := time.monotonic() - start_s) < seconds:
        poses = [ride.pose(math.fmod(now_s, 50.0) + ahead) for ahead in AHEAD_S]
        named = [dict(zip(rig.coordinates, pose, strict=True)) for pose in poses]
        client.cues([{"dt": dt, **n} for dt, n in zip(AHEAD_S, named, strict=True)])
        time.sleep(0.02)


def _spent_s(pid: int) -> tuple[float, float]:
    """Processor time of the control process and of its child, the gateway."""
    children = Path(f"/proc/{pid}/task/{pid}/children").read_text().split()
    gateway = sum(_of_process(int(child)) for child in children)
    return _of_process(pid), gateway


def _of_process(pid: int) -> float:
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


# canopen's master


def theirs(cycle_s: float, seconds: float) -> tuple[Cell, ...]:
    """`canopen` sends SYNC and six targets, and takes six answers, for `seconds`."""
    with (
        tempfile.TemporaryDirectory(prefix="hil-cia402-") as scratch,
        drives(rig_at(cycle_s), Path(scratch)) as (rig, line),
    ):
        spawn = multiprocessing.get_context("spawn")
        here, there = spawn.Pipe()
        urls = [(rig.can.urls[a.drive.bus], rig.address(i)) for i, a in enumerate(rig.actuators)]
        master = spawn.Process(target=_be_canopen, args=(urls, cycle_s, seconds, there))
        master.start()
        start_s, end_s, cpu_s = here.recv()
        line.send("end")
        seen: Seen = line.recv()
        master.join()
    share = 100.0 * cpu_s / (end_s - start_s)
    figures = _figures(seen, cycle_s, start_s, end_s, skips=False)
    return (*figures, share, math.nan, "-")


def _be_canopen(
    nodes: list[tuple[str, int]], cycle_s: float, seconds: float, told: Connection
) -> None:
    with suppress(PermissionError):  # without RESET_ON_FORK: its threads shall have it too
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY))
    eds = str(data_folder("drives") / "cia402" / "device.eds")
    networks = {url: canopen.Network(PortBus(url)) for url in dict.fromkeys(u for u, _ in nodes)}
    answers = 0

    def count(_: object) -> None:
        nonlocal answers
        answers += 1

    motors = []
    for network in networks.values():
        network.connect()
    for url, number in nodes:
        motor = canopen.RemoteNode(number, eds)
        networks[url].add_node(motor)
        _configure(motor, count)
        motors.append(motor)
    for network in networks.values():
        network.sync.start(cycle_s)
    for motor in motors:
        motor.rpdo[1].start(cycle_s)
    for word in (0x06, 0x07, 0x0F):
        for motor in motors:
            motor.rpdo[1][0x6040].raw = word
            motor.rpdo[1].update()
        time.sleep(0.5)
    homes = [motor.tpdo[1][0x6064].raw for motor in motors]
    stopped = threading.Event()
    start_s, cpu_s = time.monotonic(), time.process_time()
    due_s = start_s
    while (due_s := due_s + cycle_s) < start_s + seconds:
        for motor, home in zip(motors, homes, strict=True):
            target = home + 1e5 * math.sin(2.0 * (due_s - start_s))
            motor.rpdo[1][0x607A].raw = round(target)
            motor.rpdo[1].update()
        stopped.wait(max(0.0, due_s - time.monotonic()))
    end_s, cpu_s = time.monotonic(), time.process_time() - cpu_s
    if not answers:
        raise RuntimeError("no drive has answered")
    for motor in motors:
        motor.rpdo[1].stop()
    for network in networks.values():
        network.sync.stop()
        network.disconnect()
    told.send((start_s, end_s, cpu_s))


def _configure(motor: canopen.RemoteNode, count: Callable[[object], None]) -> None:
    deadline_s = time.monotonic() + PATIENCE_S
    while True:
        try:
            motor.sdo[0x6060].raw = 8
            break
        except canopen.SdoCommunicationError:
            if time.monotonic() > deadline_s:
                raise
    motor.tpdo.read()
    motor.rpdo.read()
    for pdo, variables in (
        (motor.rpdo[1], (0x6040, 0x607A)),
        (motor.tpdo[1], (0x6041, 0x6064, 0x6077)),
    ):
        pdo.clear()
        for index in variables:
            pdo.add_variable(index)
        pdo.trans_type = 1
        pdo.enabled = True
        pdo.save()
    motor.tpdo[1].add_callback(count)
    motor.nmt.state = "OPERATIONAL"
    motor.rpdo[1][0x607A].raw = motor.sdo[0x6064].raw


# figures


def _figures(
    seen: Seen, cycle_s: float, start_s: float, end_s: float, *, skips: bool = True
) -> tuple[Cell, ...]:
    """Lateness of SYNC on its own grid, missed cycles and setpoints, and how long setpoints come after it."""
    inside = (seen.sync_s > start_s) & (seen.sync_s < end_s)
    sync_s, target_s = seen.sync_s[inside], seen.target_s[inside]
    late_us = 1e6 * _lateness_s(sync_s, cycle_s, skips=skips)
    due = round((sync_s[-1] - sync_s[0]) / cycle_s) + 1
    after_us = 1e6 * (target_s - sync_s)
    after_us = after_us[np.isfinite(after_us)]
    return (
        due,
        *np.percentile(late_us, (50, 99, 99.9, 100)).tolist(),
        int(due - len(sync_s)),
        int(seen.missed[inside].sum()),
        *np.percentile(after_us, (50, 99)).tolist(),
    )


def _lateness_s(sync_s: Array, cycle_s: float, *, skips: bool) -> Array:
    """Behind the grid that the earliest SYNCs show; a master that skips cycles is late by less than one."""
    if not skips:  # each SYNC has its place, however late
        behind = sync_s - cycle_s * np.arange(len(sync_s))
        return np.asarray(np.maximum(behind - np.percentile(behind, 1.0), 0.0))
    phase = np.mod(sync_s - sync_s[0], cycle_s)
    counts, edges = np.histogram(phase, bins=200, range=(0.0, cycle_s))
    # Hardly anything comes before the edge from which on the timer wakes: begin the circle there.
    peak = int(np.argmax(counts))
    k = peak
    while counts[k % 200] > 1e-3 * counts[peak] and peak - k < 199:
        k -= 1
    return np.asarray(np.mod(phase - edges[(k + 1) % 200], cycle_s))


def parts(cycles_s: tuple[float, ...], ours_s: float, theirs_s: float) -> list[Part]:
    """Both masters at each cycle."""
    blank = Table(
        "six axes in real time, timed at the drives",
        COLUMNS,
        {},
        "canopen's master: the frames alone, no shaping, gate, states or recording",
    )
    found = []
    for cycle_s in cycles_s:
        rate = f"{1.0 / cycle_s:.0f}"
        for who, measure, seconds in (("hil", ours, ours_s), ("canopen", theirs, theirs_s)):
            row = f"{who}, {rate} Hz, {seconds:g} s"
            take = partial(_with_precedence, measure, cycle_s, seconds)
            found.append(Part(f"real-{rate}-{who}", blank, row, take))
    return found


def _with_precedence(
    measure: Callable[[float, float], tuple[Cell, ...]], cycle_s: float, seconds: float
) -> tuple[Cell, ...]:
    request_precedence()  # of the client that streams cues: it stands for a computer of its own
    return measure(cycle_s, seconds)
