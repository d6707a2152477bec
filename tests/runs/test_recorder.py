"""The recorder: what it writes, and that neither a kill nor a full disk costs more than promised."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import textwrap
from pathlib import Path
from typing import IO

import can
import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.writer import Writer

from hil.config import RigFile
from hil.errors import RunError
from hil.frames import Frame, StampedFrame
from hil.runs import Recorder, list_runs, load_run, repair, repair_run
from hil.runs.canlog import read_can_log
from hil.runs.folder import new_folder, read_meta, sha256
from hil.runs.mcapfile import McapSource
from hil.signals import Cue, Event, TimedPose

from .conftest import START_S, STARTED, tell


def test_folder_is_named_by_utc_stamp_and_rig(finished: Path) -> None:
    assert finished.name == "20260131T120000Z_motorcycle"
    assert {p.name for p in finished.iterdir()} == {
        "run.toml",
        "rig.toml",
        "recording.mcap",
        "can.log",
        "journal.mcap",
        "events.jsonl",
        "drives",
    }


def test_run_toml_says_what_ran_with_what(finished: Path, rig_toml: str) -> None:
    meta = read_meta(finished)
    assert (meta.format, meta.rig, meta.mode, meta.role) == (
        "hil-run/1",
        "motorcycle",
        "position",
        "diagnose",
    )
    assert meta.started == STARTED
    assert meta.recording is not None
    assert meta.recording.rig_sha256 == sha256(rig_toml.encode())
    assert meta.recording.versions["numpy"]
    assert meta.recording.host
    assert meta.recording.ended is not None
    assert (meta.recording.ended - STARTED).total_seconds() == pytest.approx(2.0, abs=0.02)
    assert meta.recording.end_reason == "asked for"


def test_plain_mcap_library_opens_it_with_index_schemas_and_wall_time(finished: Path) -> None:
    with (finished / "recording.mcap").open("rb") as stream:
        reader = make_reader(stream)
        summary = reader.get_summary()
        assert summary is not None
        assert summary.statistics is not None
        counts = {
            channel.topic: summary.statistics.channel_message_counts[cid]
            for cid, channel in summary.channels.items()
        }
        assert counts == {
            "/cue": 100,
            "/setpoint": 600,
            "/drive/leg1": 200,
            "/drive/leg2": 200,
            "/drive/slide": 200,
            "/imu": 800,
            "/state": 200,
            "/event": 2,
        }
        for channel in summary.channels.values():
            assert channel.message_encoding == "json"
            schema = summary.schemas[channel.schema_id]
            assert schema.encoding == "jsonschema"
            assert json.loads(schema.data)["type"] == "object"
        first = next(iter(reader.iter_messages(topics=["/state"])))
        assert first[2].log_time == round(STARTED.timestamp() * 1e9)
        assert json.loads(first[2].data)["t"] == START_S
        assert {a.name for a in reader.iter_attachments()} == {"rig.toml", "run.toml"}
        assert len(summary.chunk_indexes) >= 4


def test_bus_log_is_candump_text_with_wall_time_and_direction(finished: Path) -> None:
    line = (finished / "can.log").read_text().splitlines()[1]
    assert line == "(1769860800.001100) can0 2D1#0000000000000000 T"
    frames = list(can.CanutilsLogReader(finished / "can.log"))
    assert len(frames) == 600
    assert frames[-1].arbitration_id == 0x2D2


def test_bus_log_names_the_bus_without_its_options(
    tmp_path: Path, rig: RigFile, rig_toml: str
) -> None:
    hub = rig.can.model_copy(update={"url": "hub:/run/hil/rig?node=daemon"})
    other = rig.model_copy(update={"can": hub})
    recorder = Recorder(tmp_path, rig_toml, other, 0.0, started=STARTED, reserve_bytes=0)
    recorder.frame(StampedFrame(0.001, Frame(0x100, b"\x07")), is_sent=True)
    recorder.close()
    assert (recorder.path / "can.log").read_text().split()[-3:] == ["rig", "100#07", "T"]


def test_bus_log_may_be_blf(tmp_path: Path, rig: RigFile, rig_toml: str) -> None:
    kept = rig.recording.model_copy(update={"can_log": "blf"})
    blf = rig.model_copy(update={"recording": kept})
    recorder = Recorder(tmp_path, rig_toml, blf, 0.0, started=STARTED, reserve_bytes=0)
    sent = [StampedFrame(0.001 * k, Frame(0x100 + k, bytes(range(k % 9)))) for k in range(500)]
    for frame in sent:
        recorder.frame(frame, is_sent=False)
    recorder.close()
    read = read_can_log(recorder.path / "can.blf")
    assert [f.frame for f in read] == [f.frame for f in sent]
    assert read[7].t_s == pytest.approx(STARTED.timestamp() + 0.007, abs=1e-6)


def test_events_are_on_disk_at_once(recorder: Recorder) -> None:
    recorder.event(Event(START_S + 1.0, "fault", "drive_error", "leg2 reports E-OC"))
    line = (recorder.path / "events.jsonl").read_text()
    assert json.loads(line)["name"] == "drive_error"
    recorder.close()


def test_two_runs_within_a_second_get_two_folders(
    tmp_path: Path, rig: RigFile, rig_toml: str
) -> None:
    made = [
        Recorder(tmp_path, rig_toml, rig, 0.0, started=STARTED, reserve_bytes=0) for _ in range(2)
    ]
    for recorder in made:
        recorder.close()
    assert made[1].path.name == "20260131T120000Z_motorcycle_2"


def test_simulated_runs_have_folders_however_many_there_are(tmp_path: Path) -> None:
    names = [new_folder(tmp_path, "axis", STARTED).name for _ in range(120)]
    assert names[-1] == "20260131T120000Z_axis_120"
    assert len(set(names)) == 120


@pytest.mark.parametrize("place", ["file", "file/runs", "lost"])
def test_a_folder_of_runs_that_is_none_is_a_run_error(tmp_path: Path, place: str) -> None:
    (tmp_path / "file").touch()
    (tmp_path / "lost").symlink_to(tmp_path / "nowhere" / "at all")
    with pytest.raises(RunError, match=rf"cannot be made: .*{place} is no folder"):
        new_folder(tmp_path / place, "axis", STARTED)


def test_folder_that_cannot_be_made_is_a_run_error(
    tmp_path: Path, rig: RigFile, rig_toml: str
) -> None:
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(RunError, match="cannot be made"):
        Recorder(tmp_path / "file", rig_toml, rig, 0.0)


def test_living_recording_is_known_as_such_and_not_repaired(recorder: Recorder) -> None:
    assert [i.trouble for i in list_runs(recorder.path.parent)] == ["is being recorded"]
    for path in (recorder.path, recorder.path / "journal.mcap"):
        with pytest.raises(RunError, match="is being recorded right now"):
            repair_run(path)
    recorder.close()
    assert [i.trouble for i in list_runs(recorder.path.parent)] == [None]


KILLED = textwrap.dedent(
    """
    import os, signal, sys
    from pathlib import Path
    from hil.configfile import find_rig_file, load_rig
    from hil.runs import Recorder
    from tests.runs.conftest import START_S, STARTED, tell
    from hil.frames import Frame, StampedFrame
    rig = load_rig("motorcycle")
    text = find_rig_file("motorcycle").read_text()
    recorder = Recorder(Path(sys.argv[1]), text, rig, START_S, started=STARTED, reserve_bytes=0)
    tell(recorder, rig, 0, 777)
    os.kill(os.getpid(), signal.SIGKILL)
    """
)


def test_kill_9_costs_less_than_a_second_and_repair_completes_the_file(tmp_path: Path) -> None:
    child = subprocess.run(
        [sys.executable, "-c", KILLED, str(tmp_path)],
        cwd=Path(__file__).parents[2],
        check=False,
        timeout=60,
    )
    assert child.returncode == -signal.SIGKILL
    (info,) = list_runs(tmp_path)
    assert info.trouble == "was never ended: its recorder was killed"
    run = load_run(info.path)
    assert run.damage is not None
    assert "no end" in run.damage
    assert 7.77 - 0.55 < run.table["t"].iloc[-1] <= 7.77
    assert 7.77 - 0.55 < read_can_log(info.path / "can.log")[-1].t_s - STARTED.timestamp() <= 7.77

    repair = repair_run(info.path)
    assert repair.damage is not None
    mended = load_run(info.path)
    assert mended.damage is None
    assert mended.table.equals(run.table)
    assert list_runs(tmp_path)[0].trouble is None
    with (info.path / "recording.mcap").open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    assert repair_run(info.path).damage is None


def test_repair_keeps_what_others_wrote_in_other_encodings(tmp_path: Path) -> None:
    path = tmp_path / "theirs.mcap"
    with path.open("wb") as stream:
        writer = Writer(stream, chunk_size=500)
        writer.start(profile="ros2", library="theirs")
        writer.add_metadata("who", {"lab": "Delft"})
        json_id = writer.register_channel("/a", "json", writer.register_schema("a", "", b""))
        proto = writer.register_schema("b", "protobuf", b"\x00\xff")
        proto_id = writer.register_channel("/b", "protobuf", proto, {"frame": "base"})
        for k in range(100):
            writer.add_message(json_id, k, b'{"x": 1}', k + 1, k)
            writer.add_message(proto_id, k, bytes([k]), k + 2, k)
        writer.finish()
    assert len(list(McapSource(path))) == 100

    def told() -> list[tuple[str, dict[str, str], int, int, int, bytes]]:
        with path.open("rb") as stream:
            return [
                (c.topic, c.metadata, m.log_time, m.publish_time, m.sequence, m.data)
                for _, c, m in make_reader(stream).iter_messages(log_time_order=False)
            ]

    whole = told()
    path.write_bytes(path.read_bytes()[:-200])
    assert repair_run(path).messages == 200
    assert told() == whole
    with path.open("rb") as stream:
        reader = make_reader(stream)
        assert reader.get_header().profile == "ros2"
        assert [m.metadata for m in reader.iter_metadata()] == [{"lab": "Delft"}]


def test_two_repairs_at_once_take_nothing_from_each_other(
    finished: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = load_run(finished)
    recording = finished / "recording.mcap"
    recording.chmod(0o640)
    recording.write_bytes(recording.read_bytes()[:-200])
    copy = repair.copy_records

    def meanwhile(path: Path, stream: IO[bytes]) -> None:
        monkeypatch.setattr(repair, "copy_records", copy)
        assert repair_run(path).damage is not None
        copy(path, stream)

    monkeypatch.setattr(repair, "copy_records", meanwhile)
    assert repair_run(finished).damage is not None
    run = load_run(finished)
    assert run.damage is None
    assert run.table.equals(whole.table)
    assert recording.stat().st_mode & 0o777 == 0o640
    assert not [p for p in finished.iterdir() if p.name.startswith(".")]


FULL = textwrap.dedent(
    """
    import resource, signal, sys
    from pathlib import Path
    from hil.configfile import find_rig_file, load_rig
    from hil.runs import Recorder
    from tests.runs.conftest import START_S, STARTED, tell
    rig = load_rig("motorcycle")
    text = find_rig_file("motorcycle").read_text()
    recorder = Recorder(Path(sys.argv[1]), text, rig, START_S, started=STARTED, reserve_bytes=0)
    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (60_000, 60_000))
    tell(recorder, rig, 0, 1500)
    recorder.close()
    assert recorder.stopped.name == "recorder_stopped", recorder.stopped
    print(recorder.stopped.text)
    """
)


def test_disk_that_takes_no_more_stops_the_recorder_and_nothing_else(tmp_path: Path) -> None:
    child = subprocess.run(
        [sys.executable, "-W", "error", "-c", FULL, str(tmp_path)],
        cwd=Path(__file__).parents[2],
        capture_output=True,
        text=True,
        check=False,
        timeout=60,
    )
    assert child.returncode == 0, child.stderr
    assert child.stderr == ""
    assert "stopped: File too large; the rig goes on without" in child.stdout
    (info,) = list_runs(tmp_path)
    run = load_run(info.path)
    assert run.table["t"].iloc[-1] > 1.0
    assert run.events[-1].name == "recorder_stopped"


def test_full_disk_keeps_all_that_was_written_before(
    recorder: Recorder, rig: RigFile, monkeypatch: pytest.MonkeyPatch
) -> None:
    tell(recorder, rig, 0, 300)
    recorder.flush()

    def no_space(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(recorder._mcap, "flush", no_space)
    tell(recorder, rig, 300, 500)
    assert recorder.stopped is not None
    assert recorder.stopped.severity == "warning"
    assert "No space left on device" in recorder.stopped.text
    recorder.close()
    run = load_run(recorder.path)
    assert run.table["t"].iloc[-1] >= 2.99
    assert [e.name for e in run.events] == ["recorder_stopped"]
    (info,) = list_runs(recorder.path.parent)
    assert info.trouble == "recording stopped: No space left on device"


def test_a_disk_without_room_for_the_last_words_gets_them_once_it_has(
    recorder: Recorder, rig: RigFile, monkeypatch: pytest.MonkeyPatch
) -> None:
    def no_space(*_: object) -> None:
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as full:
        full.setattr(recorder._mcap, "flush", no_space)
        full.setattr(recorder, "_append_event", no_space)
        full.setattr("hil.runs.recorder.write_meta", no_space)
        tell(recorder, rig, 0, 200)
    assert recorder.stopped is not None
    assert read_meta(recorder.path).recording.end_reason == ""
    recorder.close("asked for")
    end = read_meta(recorder.path).recording
    assert end.end_reason == "recording stopped: No space left on device"
    assert (end.ended - STARTED).total_seconds() == pytest.approx(0.5, abs=0.02)


def test_a_disk_that_is_full_already_is_named_and_gets_no_folder(
    tmp_path: Path, rig: RigFile, rig_toml: str
) -> None:
    with pytest.raises(RunError, match=r"runs: cannot record: only \d+ MiB are free"):
        Recorder(tmp_path / "runs", rig_toml, rig, START_S, reserve_bytes=1 << 60)
    assert not (tmp_path / "runs").exists()


def test_reserve_of_the_disk_is_left_alone(
    recorder: Recorder, rig: RigFile, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(recorder, "_reserve", 1 << 60)
    tell(recorder, rig, 0, 100)
    assert recorder.stopped is not None
    assert "stay reserved" in recorder.stopped.text
    run = load_run(recorder.path)
    assert run.damage is None
    assert [e.name for e in run.events] == ["recorder_stopped"]
    (info,) = list_runs(recorder.path.parent)
    assert info.duration_s == pytest.approx(0.5, abs=0.02)
    assert info.trouble is not None
    assert info.trouble.startswith("recording stopped: only ")
    recorder.close("asked for")
    assert list_runs(recorder.path.parent) == [info]


def test_a_pose_that_comes_again_stands_once(recorder: Recorder) -> None:
    """Cues count their own times: the same pose, told again, lies a rounding beside itself."""
    for k, rounding in enumerate((0.0, 1e-7, -1e-7, 3e-8)):
        timed = tuple(TimedPose(0.02 * j, (0.0, 0.0, 0.1 * (k + j))) for j in range(3))
        recorder.cue(Cue("c", k, 0.0, START_S + 0.02 * k + rounding, timed))
    recorder.close()
    table = load_run(recorder.path).table
    assert table["t"].to_numpy() == pytest.approx(0.02 * np.arange(6), abs=1e-6)
    assert table["cue.roll"].tolist() == pytest.approx(0.1 * np.arange(6))


def test_cue_columns_show_what_was_asked_for_at_each_instant(recorder: Recorder) -> None:
    """A cue's later poses stand only until the next cue replaces them."""

    def send(seq: int, received: float, *poses: tuple[float, float]) -> None:
        timed = tuple(TimedPose(dt, (0.0, 0.0, roll)) for dt, roll in poses)
        recorder.cue(Cue("c", seq, 0.0, START_S + received, timed))

    send(1, 0.0, (0.0, 0.1), (0.1, 0.2), (0.2, 9.0))
    send(2, 0.15, (0.0, 0.3), (0.1, 0.4))
    recorder.close()
    table = load_run(recorder.path).table
    assert table["t"].to_numpy() == pytest.approx([0.0, 0.1, 0.15, 0.25], abs=1e-6)
    assert table["cue.roll"].tolist() == [0.1, 0.2, 0.3, 0.4]
