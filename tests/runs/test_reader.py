"""Reading runs: our recordings, anybody's folders, and a sentence for each way one can be broken."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from hil.config import RigFile
from hil.configfile import load_rig
from hil.errors import RunError
from hil.messages import DriveMessage, SetpointMessage, StateMessage, encode, schemas
from hil.runs import Recorder, export_run, list_runs, load_run, signal_infos
from hil.runs.mcapfile import McapSink, McapSource
from hil.signals import Cue, TimedPose

from .conftest import START_S, position, tell


def test_samples_stand_where_they_were_taken(finished: Path) -> None:
    table = load_run(finished).table
    assert table["t"].is_monotonic_increasing
    assert table["t"].is_unique
    answered = table.dropna(subset="leg2.position")
    expected = [position(1, t) for t in answered["t"]]
    assert answered["leg2.position"].to_numpy() == pytest.approx(expected, abs=1e-9)
    assert answered["leg2.force"].isna().all()
    assert len(answered) == 100
    sent = table.dropna(subset="slide.setpoint")
    assert sent["t"].iloc[0] == pytest.approx(0.0022, abs=1e-9)


def test_a_later_cue_replaces_all_that_earlier_ones_asked_for_from_its_first_pose_on(
    recorder: Recorder, rig: RigFile
) -> None:
    """Clients that look ahead unlike each other, and one that asks for poses beyond the rig's future."""
    asked = {0.00: [0.0, 0.3], 0.02: [0.35, 0.4], 0.04: [0.0], 0.06: [0.2, 1.0, 1e300]}
    for seq, (t, ahead) in enumerate(asked.items()):
        poses = tuple(TimedPose(dt, (0.1 * seq, 0.0, 0.0)) for dt in ahead)
        recorder.cue(Cue("simulator", seq, t, START_S + t, poses))
    recorder.close()
    cues = load_run(recorder.path).table
    assert cues["t"].to_numpy() == pytest.approx([0.0, 0.04, 0.26], abs=1e-6)
    assert cues["cue.yaw"].to_numpy() == pytest.approx([0.0, 0.2, 0.3])


def test_columns_are_those_of_the_rig_in_its_order(finished: Path) -> None:
    names = list(load_run(finished).table.columns)
    assert names[:7] == [
        "t",
        "cue.yaw",
        "cue.pitch",
        "cue.roll",
        "leg1.setpoint",
        "leg1.position",
        "leg1.force",
    ]
    assert names[-1] == "imu.accel_z"


def test_states_and_events_come_with_the_table(finished: Path) -> None:
    run = load_run(finished)
    assert run.states["state"].unique().tolist() == ["engaged"]
    assert run.states["setpoint.roll"].iloc[0] == 0.012
    assert run.states["age_s"].iloc[0] == 0.004
    assert [(e.t_s, e.name) for e in run.events] == [(0.0, "engaged"), (2.0, "cue_stale")]
    assert run.duration_s == pytest.approx(2.0, abs=0.06)
    assert run.damage is None


def test_bare_mcap_file_carries_its_rig_and_metadata(finished: Path, tmp_path: Path) -> None:
    alone = tmp_path / "alone.mcap"
    shutil.copyfile(finished / "recording.mcap", alone)
    run = load_run(alone)
    assert run.rig is not None
    assert run.rig.name == run.meta.rig == "motorcycle"
    assert run.table.equals(load_run(finished).table)
    assert [e.name for e in run.events] == ["engaged", "cue_stale"]


def test_file_cut_anywhere_is_read_as_far_as_it_goes(finished: Path, tmp_path: Path) -> None:
    """Whatever byte the kill hit: no crash, messages in order, none made up, none lost before it."""
    whole = (finished / "recording.mcap").read_bytes()
    all_messages = list(McapSource(finished / "recording.mcap"))
    cut = tmp_path / "cut.mcap"
    counts = []
    for size in [*range(0, len(whole), 1000), len(whole) - 1]:
        cut.write_bytes(whole[:size])
        source = McapSource(cut)
        read = list(source)
        assert read == all_messages[: len(read)]
        assert source.damage is not None
        counts.append(len(read))
    assert counts == sorted(counts)
    assert counts[-1] == len(all_messages)
    assert len(set(counts)) >= 4


@pytest.mark.parametrize("share", [0.3, 0.6, 0.999])
def test_cut_file_still_makes_a_run(finished: Path, tmp_path: Path, share: float) -> None:
    whole = (finished / "recording.mcap").read_bytes()
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(whole[: int(share * len(whole))])
    run = load_run(cut)
    assert run.damage is not None
    assert "it has no end" in run.damage
    assert run.duration_s > 0.4


def test_flipped_byte_costs_one_chunk_and_is_told(finished: Path, tmp_path: Path) -> None:
    data = bytearray((finished / "recording.mcap").read_bytes())
    data[len(data) // 2] ^= 0xFF
    hurt = tmp_path / "hurt.mcap"
    hurt.write_bytes(data)
    run = load_run(hurt)
    assert run.damage is not None
    whole = load_run(finished)
    assert 0.4 * len(whole.table) < len(run.table) < len(whole.table)


@pytest.mark.parametrize("content", [b"", b"\x89MCA", b"not an mcap file at all", b"\x00" * 4000])
def test_what_is_no_recording_is_called_so(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "x.mcap"
    path.write_bytes(content)
    with pytest.raises(RunError, match=r"holds no message|is no MCAP file") as caught:
        load_run(path)
    assert str(path) in str(caught.value)


def test_message_that_breaks_its_schema_is_counted_not_followed(recorder: Recorder) -> None:
    good = encode(SetpointMessage(START_S, "position", {"leg1": 0.6, "leg2": 0.6}))
    recorder._mcap.write("/setpoint", "setpoint", good, 1)
    recorder._mcap.write("/setpoint", "setpoint", good.replace(b"5000.0", b"5000.1"), 2)
    recorder._mcap.write("/setpoint", "setpoint", good.replace(b"0.6", b"null"), 3)
    recorder._mcap.write("/setpoint", "setpoint", good.replace(b"position", b"torque"), 4)
    recorder._mcap.write("/setpoint", "setpoint", good.replace(b"leg1", b"l\xf3g1"), 5)
    recorder._mcap.write("/elsewhere", "setpoint", b"{}", 6)
    recorder._mcap.write("/cue", "cue", b'{"seq": 0, "t": 0.0, "poses": [{"yaw": 0.0}]}', 7)
    recorder.close()
    run = load_run(recorder.path)
    assert len(run.table) == 2
    assert run.damage is not None
    assert "3 of /setpoint" in run.damage
    assert "1 of /cue" in run.damage


@pytest.mark.parametrize("line", [b"\x00" * 300 + b"\n", b'{"t": 5000.1, "name": "caf\xe9"}\n'])
def test_events_that_a_power_cut_hurt_are_read_from_the_recording(
    finished: Path, line: bytes
) -> None:
    whole = load_run(finished)
    with (finished / "events.jsonl").open("ab") as stream:
        stream.write(line)
    run = load_run(finished)
    assert run.events == whole.events
    assert run.damage is not None
    assert "events.jsonl: line 3: is no event" in run.damage
    export_run(whole, finished.parent / "theirs")
    with (finished.parent / "theirs" / "events.jsonl").open("ab") as stream:
        stream.write(line)
    with pytest.raises(RunError, match="line 3: is no event"):
        load_run(finished.parent / "theirs")


def test_signal_whose_time_runs_back_is_refused(recorder: Recorder) -> None:
    for t in (0.0, 0.01, 0.02, 0.015):
        recorder.setpoint(START_S + t, "position", {"leg1": 0.6})
    recorder.close()
    with pytest.raises(RunError, match=r"signal leg1.setpoint: time runs back at sample 4"):
        load_run(recorder.path)


def test_run_without_samples_is_no_run(recorder: Recorder) -> None:
    recorder.state(StateMessage(START_S, "offline", {}, {}, {}, 0.0, ""))
    recorder.close()
    with pytest.raises(RunError, match="holds no sample"):
        load_run(recorder.path)


def test_rig_file_changed_after_the_run_is_noticed(finished: Path) -> None:
    with (finished / "rig.toml").open("a") as stream:
        stream.write("\n# afterwards\n")
    with pytest.raises(RunError, match=r"rig.toml: was changed after the run"):
        load_run(finished)


def test_rig_file_of_another_rig_does_not_fit(finished: Path) -> None:
    with pytest.raises(RunError, match="is a run of the rig 'motorcycle', not of 'axis'"):
        load_run(finished, load_rig("axis"))


@pytest.mark.parametrize("kind", ["parquet", "csv"])
def test_export_and_back_keeps_every_sample(finished: Path, tmp_path: Path, kind: str) -> None:
    run = load_run(finished)
    folder = export_run(run, tmp_path / "out", kind)  # type: ignore[arg-type]
    assert (folder / f"signals.{kind}").is_file()
    again = load_run(folder)
    pd.testing.assert_frame_equal(again.table, run.table, check_exact=True)
    assert again.events == run.events
    assert again.rig == run.rig
    assert again.meta.rig == run.meta.rig
    assert again.meta.started == run.meta.started


def test_export_keeps_what_the_run_knows_of_its_rig(finished: Path, tmp_path: Path) -> None:
    alone = tmp_path / "alone.mcap"
    shutil.copyfile(finished / "recording.mcap", alone)
    assert load_run(export_run(load_run(alone), tmp_path / "bare")).rig == load_run(alone).rig
    (finished / "extra.parquet").write_bytes(b"speed")
    folder = export_run(load_run(finished), tmp_path / "out")
    for name in ("rig.toml", "extra.parquet", "drives/lust_cdd3000/drive.toml"):
        assert (folder / name).read_bytes() == (finished / name).read_bytes()


def test_export_keeps_what_was_played(finished: Path, tmp_path: Path) -> None:
    for name in ("experiment.toml", "experiment.csv", "custom.csv"):
        (finished / name).write_bytes(name.encode())
    folder = export_run(load_run(finished), tmp_path / "out")
    for name in ("experiment.toml", "experiment.csv", "custom.csv"):
        assert (folder / name).read_bytes() == name.encode()


def test_export_that_the_disk_does_not_take_leaves_nothing_in_the_way(
    finished: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(self: pd.DataFrame, path: Path, **_: object) -> None:
        path.write_text("t,leg1.position\n0.0,0.6\n0.01,0.6\n0.02,0.")
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(pd.DataFrame, "to_csv", full)
    with pytest.raises(RunError, match="cannot be written: No space left on device"):
        export_run(load_run(finished), tmp_path / "out", "csv")
    assert not list(tmp_path.glob("*out*"))


def test_export_never_overwrites(finished: Path, tmp_path: Path) -> None:
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "precious").write_text("x")
    with pytest.raises(RunError, match="never overwrites"):
        export_run(load_run(finished), tmp_path / "out")


GOOD = {
    "t": [0.0, 0.01, 0.02, 0.03],
    "leg1.setpoint": [0.60, 0.61, 0.62, 0.63],
    "leg1.position": [np.nan, 0.60, np.nan, 0.61],
}
RUN_TOML = 'format = "hil-run/1"\nrig = "motorcycle"\nmode = "position"\n'

Make = Callable[..., Path]


@pytest.fixture
def folder(tmp_path: Path) -> Make:
    """Makes somebody else's run folder, with changes to a good one."""

    def make(meta: str = RUN_TOML, **columns: list[object] | None) -> Path:
        path = tmp_path / "theirs"
        path.mkdir()
        (path / "run.toml").write_text(meta)
        table = {**GOOD, **{k.replace("__", "."): v for k, v in columns.items()}}
        kept = {k: v for k, v in table.items() if v is not None}
        pd.DataFrame(kept).to_csv(path / "signals.csv", index=False)
        return path

    return make


def test_folder_of_others_is_read(folder: Make) -> None:
    payload = "[payload]\nmass = 20.0\nx = 0.1\n"
    run = load_run(folder(RUN_TOML + 'role = "reference"\nlab = "Delft"\n' + payload))
    assert run.rig is None
    assert run.meta.role == "reference"
    assert run.meta.payload is not None
    assert run.meta.payload.mass == 20.0
    assert run.meta.model_extra == {"lab": "Delft"}
    assert len(run.table) == 4


@pytest.mark.parametrize(
    ("columns", "sentence"),
    [
        ({"t": None}, "signals.csv: has no column 't'"),
        ({"t": [0.0, 0.02, 0.01, 0.03]}, "column t: time runs back at row 3, from 0.020000 s"),
        ({"t": [0.0, 0.01, 0.01, 0.03]}, "column t: time stands still at row 3"),
        ({"t": [0.0, np.nan, 0.01, 0.03]}, "column t, row 2: is empty"),
        ({"leg1__force": [1, "two", 3, 4]}, "column leg1.force, row 2: 'two' is not a finite num"),
        (
            {"leg1__force": [1, 2, np.inf, 4]},
            "column leg1.force, row 3: inf is not a finite number",
        ),
        ({"leg1__force": [np.nan] * 4}, "column leg1.force, rows 1 to 4: holds no sample at all"),
        ({"leg1__postion": [1, 2, 3, 4]}, "'leg1.postion' is no signal that hil has; is 'leg1.pos"),
        ({"cue__rol": [1, 2, 3, 4]}, "'cue.rol' is no signal that hil has; is 'cue.roll' meant?"),
        ({"leg1__setpoint": None, "leg1__position": None}, "4 rows of 0 signals, that is no run"),
    ],
)
def test_broken_table_gets_its_sentence(
    folder: Make, columns: dict[str, list[object] | None], sentence: str
) -> None:
    with pytest.raises(RunError) as caught:
        load_run(folder(**columns))
    assert sentence in str(caught.value)
    assert "signals.csv" in str(caught.value)


def test_two_tables_of_one_folder_must_say_the_same(folder: Make, finished: Path) -> None:
    path = folder()
    pd.DataFrame(GOOD).to_parquet(path / "signals.parquet")
    assert len(load_run(path).table) == len(GOOD["t"])
    changed = pd.DataFrame(GOOD)
    changed["t"] += 1.0
    changed.to_parquet(path / "signals.parquet")
    with pytest.raises(RunError, match=f"{path}: signals.parquet and signals.csv do not say the"):
        load_run(path)
    pd.DataFrame(GOOD).to_csv(finished / "signals.csv")  # an export beside the record
    assert len(load_run(finished).table) > len(GOOD["t"])


@pytest.mark.parametrize(
    ("meta", "sentence"),
    [
        ("", "format is None, hil reads 'hil-run/1'"),
        ('format = "hil-run/2"\nrig = "x"', "format is 'hil-run/2'"),
        ('format = "hil-run/1"', "rig: field required"),
        (RUN_TOML.replace("position", "sideways"), "mode: input should be 'position', 'force'"),
        (
            RUN_TOML + "[payload]\nmass = -3",
            "payload.mass: input should be greater than or equal to 0",
        ),
        (RUN_TOML + '[payload]\nmass = "heavy"', "payload.mass: input should be a valid number"),
        ("format = ", "is no TOML"),
        (
            RUN_TOML + "started = 0001-01-01T00:00:00+14:00",
            "started: value error, 0001-01-01 00:00:00+14:00 is no instant",
        ),
        (
            RUN_TOML + "[recording]\nstart_s = nan",
            "recording.start_s: input should be a finite number",
        ),
    ],
)
def test_broken_run_toml_gets_its_sentence(folder: Make, meta: str, sentence: str) -> None:
    path = folder(meta)
    with pytest.raises(RunError) as caught:
        load_run(path)
    assert sentence in str(caught.value)
    assert "run.toml" in str(caught.value)
    assert list_runs(path.parent)[0].trouble == str(caught.value)


@pytest.mark.parametrize("name", ["run.toml", "rig.toml"])
@pytest.mark.parametrize("text", [b"format = ", b"\xff\xfe"])
def test_broken_toml_inside_a_bare_mcap_file_gets_its_sentence(
    tmp_path: Path, name: str, text: bytes
) -> None:
    path = tmp_path / "alone.mcap"
    with path.open("wb") as stream:
        sink = McapSink(stream, schemas())
        for attached, data in {"run.toml": RUN_TOML.encode(), name: text}.items():
            sink.attach(attached, "application/toml", data, 0)
        sink.write("/drive/leg1", "drive", encode(DriveMessage(0.0, position=0.6)), 0)
        sink.finish()
    with pytest.raises(RunError, match=rf"alone\.mcap: {name}: is no TOML"):
        load_run(path)


def test_rows_with_a_cell_too_many_are_no_shifted_columns(folder: Make) -> None:
    path = folder()
    rows = ["0.0,0.6,0.6,1", "0.1,0.7,0.6,2", "0.2,0.8,0.7,3"]
    for cut in (0, 1):
        lines = [
            "t,leg1.setpoint,leg1.position",
            *(r[: -2 * cut or None] for r in rows[:2]),
            rows[2],
        ]
        (path / "signals.csv").write_text("\n".join(lines))
        with pytest.raises(RunError, match=r"signals.csv: is no table of separated values"):
            load_run(path)


@pytest.mark.parametrize("zone", ["", "Z", "+02:00"])
def test_times_without_a_zone_are_utc_wherever_they_are_read(folder: Make, zone: str) -> None:
    ended = "[recording]\nended = 2026-01-31T12:00:02Z\n"
    path = folder(RUN_TOML + f"started = 2026-01-31T12:00:00{zone}\n" + ended)
    hour = 10 if zone == "+02:00" else 12
    run = load_run(path)
    assert run.meta.started is not None
    assert run.meta.started.isoformat() == f"2026-01-31T{hour}:00:00+00:00"
    (info,) = list_runs(path.parent)
    assert info.duration_s == 2.0 + 3600.0 * (12 - hour)


def test_signal_that_this_rig_has_not_is_refused(folder: Make, rig: RigFile) -> None:
    path = folder(leg4__position=[0.6] * 4)
    load_run(path)
    with pytest.raises(RunError, match=r"'leg4\.position' is no signal that the rig 'motorcycle'"):
        load_run(path, rig)


def test_millimetres_are_recognised(folder: Make, rig: RigFile) -> None:
    path = folder(leg1__position=[600.0, 601.0, np.nan, 603.0])
    with pytest.raises(RunError, match=r"leg1.position, from row 1: .* are these millimetres"):
        load_run(path, rig)


def test_a_path_may_be_text(folder: Make) -> None:
    path = folder()
    assert load_run(str(path)).table.equals(load_run(path).table)


def test_folder_without_anything_to_read(tmp_path: Path) -> None:
    with pytest.raises(RunError, match="no such run"):
        load_run(tmp_path / "nothing")
    with pytest.raises(RunError, match=r"is no run folder, it has no run.toml"):
        load_run(tmp_path)
    (tmp_path / "run.toml").write_text(RUN_TOML)
    with pytest.raises(RunError, match=r"holds none of recording.mcap, signals.parquet"):
        load_run(tmp_path)
    (tmp_path / "signals.parquet").write_bytes(b"PAR1 but not really")
    with pytest.raises(RunError, match=r"signals.parquet: cannot be read"):
        load_run(tmp_path)
    (tmp_path / "signals.txt").write_text("")
    with pytest.raises(RunError, match=r"neither a run folder nor an \.mcap file"):
        load_run(tmp_path / "signals.txt")


def test_list_is_newest_first_and_reads_no_recording(
    recorder: Recorder, rig: RigFile, rig_toml: str, tmp_path: Path
) -> None:
    recorder.close()
    later = Recorder(tmp_path / "runs", rig_toml, rig, 0.0, note="second", reserve_bytes=0)
    tell(later, rig, 0, 1)
    later.close()
    infos = list_runs(tmp_path / "runs")
    assert [i.note for i in infos] == ["second", ""]
    assert infos[0].rig == "motorcycle"
    assert infos[0].size_bytes > 0
    assert list_runs(tmp_path / "nowhere") == []


def test_list_goes_by_the_start_and_not_by_the_name(tmp_path: Path) -> None:
    told = {
        "zz_import": "started = 2025-05-01T00:00:00Z",
        "imported": "",
        **dict.fromkeys(("a_axis", "a_axis_2", "a_axis_10"), "started = 2026-01-01T00:00:00Z"),
        "0_late": "started = 2026-02-01T00:00:00+02:00",
    }
    for name, line in told.items():
        (tmp_path / name).mkdir()
        (tmp_path / name / "run.toml").write_text(f'format = "hil-run/1"\nrig = "axis"\n{line}\n')
    newest_first = ["0_late", "a_axis_10", "a_axis_2", "a_axis", "zz_import", "imported"]
    assert [i.path.name for i in list_runs(tmp_path)] == newest_first


def test_signals_are_told_with_rate_gap_and_range(finished: Path) -> None:
    infos = {i.name: i for i in signal_infos(load_run(finished))}
    leg1 = infos["leg1.position"]
    assert leg1.samples == 100
    assert leg1.rate_hz == pytest.approx(50.0, rel=1e-6)
    assert leg1.longest_gap_s == pytest.approx(0.02, abs=1e-9)
    assert 0.579 < leg1.lowest < leg1.highest < 0.621
    assert infos["imu.gyro_x"].rate_hz == pytest.approx(200.0, rel=1e-6)
