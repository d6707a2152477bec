"""From the sensor nodes to a run: buttons, lost and late frames, and live beside offline computation."""

import asyncio
import contextlib
import time
from types import SimpleNamespace

import cantools
import numpy as np
import pytest

from hil.bicycle.acquisition import Acquisition, Told, acquire
from hil.bicycle.analysis import analyse
from hil.bicycle.nodes import frames_of, play
from hil.bicycle.recorded import prepare
from hil.bus.hub import Hub
from hil.bus.port import open_port
from hil.configfile import data_folder, load_bicycle
from hil.drives.bicycle_nodes import (
    Button,
    NodeClock,
    NodesReceiver,
    Pressed,
    encode_button,
    encode_lean,
    encode_steer,
    encode_wheel,
)
from hil.drives.imu_node import encode as encode_imu
from hil.errors import BusError
from hil.frames import Frame, StampedFrame
from hil.runs import Recorder, load_run
from hil.runs.folder import read_meta


@pytest.fixture(scope="module")
def dbc():
    return cantools.database.load_file(data_folder("drives") / "bicycle_nodes" / "frames.dbc")


def test_the_dbc_reads_what_the_nodes_send(dbc):
    base = load_bicycle("bicycle").sensors.base_id
    frames = [
        encode_lean(base, -0.2, 65537, saturated=True),
        encode_wheel(base, 1234.5, 2400, 9),
        encode_steer(base, -0.3, 2400, 10),
        encode_button(base, Button.CALIBRATE),
        *encode_imu(0xA0, (0.1, -0.2, 0.3), (1.0, -2.0, 9.8), 11),
    ]
    said = {}
    for frame in frames:
        said |= dbc.decode_message(frame.can_id, frame.data, decode_choices=False)
    assert said["Lean"] == pytest.approx(-0.2)
    assert said["Saturated"] == 1
    assert said["LeanCounter"] == 1
    assert said["WheelCount"] == pytest.approx(1234.5 * 2400 / (2 * np.pi), abs=0.5)
    assert said["SteerCount"] == pytest.approx(-0.3 * 2400 / (2 * np.pi), abs=0.5)
    assert said["Button"] == 3
    assert (said["GyroZ"], said["AccelY"]) == pytest.approx((0.3, -2.0))


def test_what_is_encoded_is_received():
    rig = load_bicycle("bicycle")
    nodes = NodesReceiver(rig)
    base = rig.sensors.base_id
    (lean,) = nodes.on_frame(1.0, encode_lean(base, 0.1234, 7, saturated=False))
    assert (lean.source, lean.quantity, lean.value) == ("bicycle", "lean", pytest.approx(0.1234))
    (pressed,) = nodes.on_frame(1.5, encode_button(base, Button.STOP))
    assert pressed == Pressed(1.5, Button.STOP)
    assert nodes.on_frame(1.6, Frame(0x7FF, b"12345678")) == []
    assert nodes.on_frame(1.7, Frame(base, b"123")) == []
    assert nodes.on_frame(1.8, Frame(base + 3, b"\x09")) == []
    assert nodes.malformed == 2


def test_a_32_bit_counter_that_runs_over_goes_on():
    rig = load_bicycle("bicycle")
    nodes = NodesReceiver(rig)
    steps = rig.sensors.steps_per_turn
    step = 2.0 * np.pi / steps
    angles = (2**31 + np.array([-3.0, -1.0, 2.0, 5.0, -2.0])) * step
    found = [
        nodes.on_frame(0.01 * k, encode_wheel(rig.sensors.base_id, a, steps, k))[0].value
        for k, a in enumerate(angles)
    ]
    np.testing.assert_allclose(np.diff(found), np.diff(angles), atol=1e-6)


def test_lost_frames_are_counted_and_late_ones_stamped_when_they_were_taken():
    rig = load_bicycle("bicycle")
    nodes = NodesReceiver(rig)
    base = rig.sensors.base_id
    got = []
    for n in range(400):
        if n in (50, 51, 52):
            continue
        taken = 0.01 * n * (1.0 + 1e-4)  # its clock is slow by 100 ppm
        waits = 0.3 - 0.01 * (n - 200) if 200 <= n < 230 else 0.0004
        got += [(s.sampled_s, taken) for s in nodes.on_frame(
            taken + max(waits, 0.0004), encode_lean(base, 0.0, n, saturated=False))]  # fmt: skip
    assert nodes.lost["lean"] == 3
    sampled, taken = np.array(got).T
    assert np.abs(sampled - taken).max() < 0.002
    assert np.all(np.diff(sampled) > 0.0)


def test_frames_that_come_twice_and_nodes_that_begin_anew_are_no_loss():
    rig = load_bicycle("bicycle")
    nodes = NodesReceiver(rig)
    base, imu = rig.sensors.base_id, rig.can.imu_base_id
    for k, counter in enumerate([1000, 1001, 1001, 1002, 0, 1, 3]):
        for frame in (
            encode_lean(base, 0.1, counter, saturated=False),
            *encode_imu(imu, (0.0, 0.0, 0.0), (0.0, 0.0, 9.8), counter),
        ):
            nodes.on_frame(0.01 * k, frame)
    assert (nodes.lost["lean"], nodes.imu.lost) == (1, 2)


def test_a_counter_that_starts_anew_is_followed():
    clock = NodeClock(0.01)
    assert clock.sampled_s(1, 10.0) == pytest.approx(10.0)
    assert clock.sampled_s(40000, 10.01) == pytest.approx(10.01)


def run_through(ride, folder, *, start_at=0.0):
    """The ride through nodes and acquisition in simulated time."""
    told = []
    acquisition = Acquisition(ride.rig, folder, told.append)
    due = start_at
    for t, frame in frames_of(ride.rig, ride.table):
        while due < t + start_at:
            acquisition.on_time(due)
            due += 0.1
        acquisition.on_frame(StampedFrame(t + start_at, frame))
    return acquisition, told


@pytest.fixture(scope="module")
def recorded(weaving, tmp_path_factory):
    return run_through(weaving, tmp_path_factory.mktemp("runs"), start_at=1000.0)


def test_a_panel_that_starts_where_nothing_can_be_recorded_is_told_and_no_more(weaving, tmp_path):
    (tmp_path / "runs").write_text("a file where the folder should be")
    told = []
    acquisition = Acquisition(weaving.rig, tmp_path / "runs", told.append, live=False)
    start = encode_button(weaving.rig.sensors.base_id, Button.START)
    acquisition.on_frame(StampedFrame(1.0, start))
    assert not acquisition.is_recording
    assert [t.event.name for t in told] == ["not_recording"]


def test_the_panel_makes_a_run_and_it_holds_the_ride(recorded, weaving):
    acquisition, told = recorded
    assert not acquisition.is_recording
    (path,) = acquisition.paths
    run = load_run(path)
    assert run.meta.mode == "ride"
    assert run.meta.recording.end_reason == "stopped by the panel"
    assert any("frames lost: lean 0" in t.text for t in told)
    ours, theirs = prepare(run, run.bicycle), weaving.table
    for k, signal in enumerate(("lean", "rear_wheel", "steer")):
        rows = theirs[["t", signal]].dropna()
        sent = np.interp(ours.t_s, rows["t"], rows[signal])
        assert np.sqrt(np.mean((ours.angles[:, k] - sent + sent[0] * (k == 1)) ** 2)) < (
            0.02 if k == 1 else 0.003
        )
    assert analyse(ours).compared[-1].explained > 0.5


def test_live_is_the_offline_analysis_half_a_second_late(recorded):
    acquisition, told = recorded
    states = [t.state for t in told if t.state is not None]
    run = load_run(acquisition.paths[0])
    motion = analyse(prepare(run, run.bicycle)).motion
    ride = prepare(run, run.bicycle)
    t = np.array([s.t_s for s in states]) - 1000.0
    assert len(states) > 100
    later = slice(20, -10)
    for name, offline, limit in (
        ("lean", motion.q[:, 3], 0.002),
        ("steer", motion.q[:, 6], 0.002),
        ("speed", motion.speed, 0.02),
        ("x", motion.q[:, 0], 0.1),
        ("y", motion.q[:, 1], 0.3),
        ("normal_front", motion.normal[:, 1], 8.0),
        ("steer_torque", motion.steer_torque, 0.3),
    ):
        live = np.array([getattr(s, name) for s in states])
        expected = np.interp(t, ride.t_s, offline)
        assert np.abs(live - expected)[later].max() < limit, name
    assert abs(np.mean([s.imu_off["gyro_z"] for s in states])) < 0.002


def test_a_silent_node_is_named(weaving, tmp_path):
    told = []
    acquisition = Acquisition(weaving.rig, tmp_path, told.append, live=False)
    steer = weaving.rig.sensors.base_id + 2
    for t, frame in frames_of(weaving.rig, weaving.table):
        if t > 4.0:
            break
        if frame.can_id != steer:
            acquisition.on_frame(StampedFrame(t, frame))
            acquisition.on_time(t)
    acquisition.stop(4.0, "enough")
    silent = [t.text for t in told if "said nothing" in t.text]
    assert silent == ["steer has said nothing for 1 s: its power, its cable, its identifier"]


@pytest.mark.parametrize("ends", ["by itself", "as it is told to"])
def test_a_ride_that_the_disk_ended_is_told_to_everybody(weaving, tmp_path, monkeypatch, ends):
    told: list[Told] = []
    recording = Acquisition(weaving.rig, tmp_path, told.append, live=False)
    recording.start(0.0)
    monkeypatch.setattr("hil.runs.recorder.shutil.disk_usage", lambda _: SimpleNamespace(free=0))
    if ends == "by itself":
        recording.on_frame(StampedFrame(1.0, Frame(0x7FF, b"")))
        recording.on_time(1.0)
        recording.on_time(1.1)
    else:
        monkeypatch.setattr(Recorder, "_finish", _no_space)
        recording.stop(1.0, "told to")
    events = [t.event for t in told if t.event is not None]
    assert [e.name for e in events].count("recorder_stopped") == 1
    assert not recording.is_recording
    assert "stopped: " in read_meta(recording.paths[0]).recording.end_reason


def _no_space(_):
    raise OSError(28, "No space left on device")


def test_over_a_real_bus_with_real_clocks(weaving, tmp_path):
    """The panel's stop ends the run, however late a busy machine lets it through."""

    async def go():
        url = f"hub:{tmp_path}/bus.sock"
        async with Hub(tmp_path / "bus.sock", 500_000):
            told, ended = [], asyncio.Event()

            def tell(said):
                told.append(said)
                if said.event is not None and said.event.name == "ride_ended":
                    ended.set()

            acquisition = Acquisition(weaving.rig, tmp_path / "runs", tell)
            with (
                contextlib.closing(open_port(url, bitrate_bps=500_000)) as ours,
                contextlib.closing(open_port(url, bitrate_bps=500_000)) as theirs,
            ):
                short = weaving.table[weaving.table["t"] < 2.0]
                recording = asyncio.create_task(
                    acquire(acquisition, ours, time.monotonic, None, wait=True)
                )
                unsent = await play(frames_of(weaving.rig, short), theirs, time.monotonic)
                await asyncio.wait_for(ended.wait(), 30.0)
                recording.cancel()
                with contextlib.suppress(asyncio.CancelledError):
                    await recording
            return acquisition, told, unsent, short

    acquisition, told, unsent, short = asyncio.run(go())
    assert unsent == 0
    assert any("frames lost: lean 0, rear_wheel 0, steer 0, imu 0" in t.text for t in told)
    run = load_run(acquisition.paths[0])
    assert run.meta.recording.end_reason == "stopped by the panel"
    for signal in ("lean", "rear_wheel", "steer", "imu.gyro_z"):
        assert run.table[signal].notna().sum() == short[signal].notna().sum()
    assert (acquisition.paths[0] / "can.log").stat().st_size > 1000


def test_a_bus_that_goes_away_ends_the_run_and_is_its_reason(weaving, tmp_path):
    async def go(acquisition):
        url = f"hub:{tmp_path}/bus.sock"
        async with Hub(tmp_path / "bus.sock", 500_000):
            port = open_port(url, bitrate_bps=500_000)
            recording = asyncio.create_task(
                acquire(acquisition, port, time.monotonic, None, wait=True)
            )
            with contextlib.closing(open_port(url, bitrate_bps=500_000)) as nodes:
                nodes.send(encode_button(weaving.rig.sensors.base_id, Button.START))
                for k in range(5):
                    lean = encode_lean(weaving.rig.sensors.base_id, 0.1, k, saturated=False)
                    nodes.send(lean)
                    await asyncio.sleep(0.05)
        with contextlib.closing(port):
            await recording

    acquisition = Acquisition(weaving.rig, tmp_path / "runs", lambda told: None, live=False)
    with pytest.raises(BusError, match="closed"):
        asyncio.run(go(acquisition))
    run = load_run(acquisition.paths[0])
    assert run.meta.recording.end_reason.startswith("the bus failed: ")
