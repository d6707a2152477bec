"""A recorded run through the control code again: the same to the frame, or a difference one can read."""

import asyncio
import json
import shutil

import pytest
from typer.testing import CliRunner

from hil.bus.faults import Drop, NodeOff
from hil.cli.app import app
from hil.configfile import data_folder, rig_toml
from hil.daemon.gateway.recording import Recording
from hil.daemon.ipc import Sources
from hil.daemon.recording import keep
from hil.daemon.records import FrameRecord, InputRecord
from hil.daemon.replay import Replay, replay_run
from hil.daemon.simulated import EPOCH, SimulatedSession
from hil.errors import RunError
from hil.frames import Frame
from hil.runs import Recorder
from hil.runs.folder import RunMeta, write_meta
from tests.daemon.simulated_rig import PROFILES, Session, rig_file

RIG = rig_file("axis")


class Taped(Session):
    """A session that is recorded as the daemon's are."""

    def __init__(self, folder, rig=RIG, **options):
        recorder = Recorder(folder, rig_toml(rig), rig, 0.0, started=EPOCH)
        super().__init__(rig, recorder=recorder, **options)

    def end(self):
        self.leave()
        self.recorder.close("test")
        return self.recorder.path


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    session = Taped(tmp_path_factory.mktemp("runs"), wake_jitter_s=0.0005).engaged(2.0)
    session.command("gain", "0.8")
    session.ride(1.0)
    session.command("nonsense")
    return session.end()


def invoke(*arguments):
    return CliRunner().invoke(app, ["replay", *map(str, arguments)])


def test_every_frame_comes_out_the_same(run):
    found = replay_run(run, RIG, PROFILES)
    assert found.is_same
    assert found.frames == found.same > 500
    assert (found.lost, found.damage, found.differences) == (0, None, [])


def test_a_run_with_a_broken_bus_replays_too(tmp_path):
    faults = (
        Drop(ids=(0x52A,), probability=0.05, after_s=1.0),
        NodeOff(node="control", at_s=4.0, for_s=0.3),
    )
    session = Taped(tmp_path, faults=faults)
    session.run_until(2.5)
    session.command("arm")
    session.ride(2.5)
    assert {"refused", "refused_off"} & {r.what for r in session.of(InputRecord)}
    found = replay_run(session.end(), RIG, PROFILES)
    assert found.is_same
    assert found.frames > 200


def test_another_limit_gives_a_difference_with_time_and_size(run):
    slower = rig_file("axis", cue={"velocity": [0.05]})
    found = replay_run(run, slower, PROFILES)
    assert not found.is_same
    assert found.changed > 50
    first = found.differences[0]
    assert first.recorded.can_id == first.replayed.can_id == 0x296  # the control frame of address 1
    kind, off, _ = found.largest[0]
    assert kind == "position"
    assert 0.0 < off < RIG.limits[0]


def test_a_lost_input_is_counted(run):
    records = [InputRecord(1, 0.0, "start"), InputRecord(5, 0.1, "gateway")]
    assert Replay(RIG, PROFILES).run(records).lost == 3


def test_frames_that_are_no_longer_sent_or_new_are_told_apart():
    session = SimulatedSession(RIG, PROFILES)
    records = []
    session.on_record = records.append
    session.run_until(2.0)
    sent = [k for k, r in enumerate(records) if isinstance(r, FrameRecord) and r.is_sent]
    less = [r for k, r in enumerate(records) if k != sent[10]]
    found = Replay(RIG, PROFILES).run(less)
    assert (found.extra, found.missing, found.changed) == (1, 0, 0)
    assert found.differences[0].recorded is None
    records[sent[10]] = records[sent[10]]._replace(frame=Frame(0x123))
    found = Replay(RIG, PROFILES).run(records)
    assert (found.extra, found.missing, found.changed) == (1, 1, 0)


def test_a_recording_from_the_middle_is_refused(run):
    with pytest.raises(RunError, match="begins in the middle"):
        Replay(RIG, PROFILES).run([InputRecord(700, 7.0, "due")])


def test_a_run_without_a_journal_is_refused(run, tmp_path):
    (tmp_path / "run.toml").write_bytes((run / "run.toml").read_bytes())
    with pytest.raises(RunError, match=r"journal\.mcap"):
        replay_run(tmp_path, RIG, PROFILES)


def test_a_journal_that_was_cut_is_replayed_as_far_as_it_goes(run, tmp_path):
    whole = (run / "journal.mcap").read_bytes()
    (tmp_path / "journal.mcap").write_bytes(whole[: len(whole) * 2 // 3])
    found = replay_run(tmp_path, RIG, PROFILES)
    assert found.is_same
    assert 0 < found.frames < replay_run(run, RIG, PROFILES).frames
    assert "no end" in found.damage


def test_the_drive_file_that_ran_is_kept_and_is_what_is_replayed(run, tmp_path):
    kept = run / "drives/lust_cdd3000/drive.toml"
    assert kept.read_text() == (data_folder("drives") / "lust_cdd3000/drive.toml").read_text()
    other = tmp_path / "run"
    shutil.copytree(run, other)
    told = kept.read_text()
    assert "listen = 0.25" in told
    (other / "drives/lust_cdd3000/drive.toml").write_text(
        told.replace("listen = 0.25", "listen = 0.35")
    )
    assert invoke(other).exit_code == 1
    shutil.rmtree(other / "drives")  # a run from before they were kept
    assert invoke(other).exit_code == 0


def switched(folder, *, off_s, most_bytes=None):
    """A ride whose recording is switched off for a while, and the folders of both parts."""
    told = []
    recording = Recording(folder, rig_toml(RIG), RIG, told.append)
    session = Session(RIG)
    session.on_record = lambda record: recording.put(
        lambda recorder: keep(recorder, [(record, None)], RIG, Sources(RIG.actuator_names))
    )

    async def scene():
        await recording.start()
        first = recording.path
        session.engaged(1.0)
        assert (await recording.stop("test")).ok
        assert recording.path is None
        if most_bytes is not None:
            recording._thread.recorder._left = most_bytes
        session.ride(off_s)
        await recording.start()
        second = recording.path
        session.ride(0.5)
        session.leave()
        await recording.close("test")
        assert recording.dropped == 0
        return first, second

    runs = asyncio.run(scene())
    assert sorted(folder.iterdir()) == sorted(runs)
    return runs


def test_a_recording_that_was_switched_on_later_is_replayed_from_the_daemons_start(tmp_path):
    first, second = (replay_run(run, RIG, PROFILES) for run in switched(tmp_path, off_s=1.0))
    assert first.is_same
    assert second.is_same
    assert second.lost == 0
    assert second.frames > first.frames + 100


def test_one_that_began_after_more_than_is_kept_says_so(tmp_path):
    _, second = switched(tmp_path, off_s=0.5, most_bytes=1000)
    with pytest.raises(RunError, match="begins in the middle"):
        replay_run(second, RIG, PROFILES)


def test_the_command_says_that_all_is_the_same(run):
    result = invoke(run)
    assert result.exit_code == 0, result.output
    assert "frames came out the same" in result.output


def test_the_command_shows_the_first_differences_in_words(run, tmp_path):
    slower = tmp_path / "slower.toml"
    slower.write_text(rig_toml(rig_file("axis", cue={"velocity": [0.05]})))
    result = invoke(run, "--rig", slower, "--most", "2")
    assert result.exit_code == 1
    assert "setpoints differ by up to" in result.output
    assert "axis control: enable" in result.output
    assert result.output.count("    + ") == 2
    shown = json.loads(invoke(run, "--rig", slower, "--json").output)
    assert not shown["is_same"]
    assert shown["changed"] > 0
    assert shown["differences"][0]["replayed"]["source"] == "axis"


def test_the_command_refuses_the_file_of_another_rig(tmp_path):
    write_meta(tmp_path, RunMeta(rig="axis", mode="position"))
    result = invoke(tmp_path, "--rig", "motorcycle")
    assert result.exit_code != 0
    assert f"{tmp_path}: is a run of the rig 'axis', not of 'motorcycle'" in str(result.exception)
