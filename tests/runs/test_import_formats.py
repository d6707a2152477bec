"""Whatever wrote the log, the run that comes of it holds the same motion in SI units."""

from __future__ import annotations

import gzip
import json
import time
import tomllib
from datetime import UTC, datetime
from pathlib import Path

import can
import cantools
import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.csv
import pytest
import scipy.io
from mcap.writer import Writer
from typer.testing import CliRunner

from hil.cli.app import app
from hil.configfile import data_folder, load_rig
from hil.errors import RunError
from hil.runs import load_run
from hil.runs.importing import find_map, import_run, load_map
from tests.runs.foreign import CLOCK, SIGNALS, as_csv, bring, brought, map_file, motion

MOTION = motion()


def holds_the_motion(run, atol=1e-9):
    t = (MOTION["time"].to_numpy() - MOTION["time"][0]) * 1e-3
    for signal, column, factor in (
        ("axis.setpoint", "target", 1e-3),
        ("axis.position", "actual", 1e-3),
        ("axis.velocity", "speed", 1e-3),
        ("axis.force", "force", 1e3),
    ):
        there = run.table[signal].notna()
        at = run.table["t"][there].to_numpy()
        assert len(at) == len(t), signal
        np.testing.assert_allclose(at, t, rtol=0, atol=2e-6, err_msg=signal)
        values = run.table[signal][there].to_numpy()
        np.testing.assert_allclose(values, factor * MOTION[column], rtol=0, atol=atol * factor)
    return True


@pytest.mark.parametrize("separator", [",", ";", "\t", "|", "   "])
def test_csv_with_any_separator(tmp_path, separator):
    path = tmp_path / "log.csv"
    rows = [MOTION.columns, *MOTION.to_numpy().astype(str)]
    path.write_text("\n".join(separator.join(row) for row in rows), encoding="utf-8")
    assert holds_the_motion(brought(path))


def test_csv_as_a_german_logger_writes_it(tmp_path):
    path = tmp_path / "log.csv"
    text = MOTION.to_csv(index=False, sep=";", decimal=",")
    path.write_text("Messung vom Montag\n# Kanäle\n" + text, encoding="latin-1")
    how = '[file]\nskip_rows = 1\ndecimal = ","\nencoding = "latin-1"\n'
    assert holds_the_motion(brought(path, how + CLOCK + SIGNALS))


@pytest.mark.parametrize("columns", [MOTION.columns, ["time"]])
def test_decimal_commas_that_the_map_does_not_say_are_told_with_the_key(tmp_path, columns):
    path = tmp_path / "log.csv"
    table = MOTION.copy()
    for column in columns:
        table[column] = [f"{v:.6f}".replace(".", ",") for v in table[column]]
    table.to_csv(path, index=False, sep=";")
    with pytest.raises(RunError, match=r'is not a finite number: .* decimal = "," under \[file\]'):
        brought(path)


def test_lines_that_begin_with_the_comment_sign_are_passed_over(tmp_path):
    path = as_csv(tmp_path, MOTION)
    lines = path.read_text().splitlines(keepends=True)
    lines[400:400] = ["# the cable came off, and on again\n", "  # 1,2,3,4,5\n"]
    path.write_text("\ufeff# Monday, 3 of 4\n" + "".join(lines), encoding="utf-8")
    assert holds_the_motion(brought(path))


@pytest.mark.parametrize("cell", ["1.#QNAN", "-1.#IND"])
def test_no_number_as_windows_prints_it_is_no_sample_and_loses_no_neighbour(tmp_path, cell):
    table = MOTION.astype(object)
    table.loc[300, "actual"] = cell
    run = brought(as_csv(tmp_path, table))
    missing = run.table.index[run.table["axis.position"].isna()]
    assert list(missing) == [300]
    assert run.table["axis.force"].notna().all()


def test_names_may_hold_the_separator_and_a_byte_order_mark_is_no_name(tmp_path):
    path = tmp_path / "log.csv"
    head = ",".join(f'"{c}"' for c in MOTION.columns)
    rows = MOTION.assign(**{"a, b": 1.0}).to_csv(index=False, header=False)
    path.write_text(f'{head},"a, b"\n{rows}', encoding="utf-8-sig")
    assert holds_the_motion(brought(path))


def test_csv_without_header_by_number_or_by_names_of_the_map(tmp_path):
    path = tmp_path / "log.txt.gz"
    with gzip.open(path, "wt") as stream:
        np.savetxt(stream, MOTION.to_numpy(), fmt="%.17g")
    named = "[file]\nnames = [" + ", ".join(f'"{c}"' for c in MOTION.columns) + "]\n"
    assert holds_the_motion(brought(path, named + CLOCK + SIGNALS))
    numbered = CLOCK + SIGNALS
    for number, column in enumerate(MOTION.columns, start=1):
        numbered = numbered.replace(f'"{column}"', f'"{number}"')
    (tmp_path / "again").mkdir()
    assert holds_the_motion(brought(path.rename(tmp_path / "again" / path.name), numbered))


def test_parquet_with_dates_and_the_date_becomes_the_start(tmp_path):
    began = pd.Timestamp("2026-01-31T12:00:00.5Z")
    table = MOTION.assign(time=began + pd.to_timedelta(MOTION["time"] - 7000.0, unit="ms"))
    path = tmp_path / "log.parquet"
    table.to_parquet(path)
    run = brought(path, CLOCK.replace("ms", "datetime") + SIGNALS)
    assert holds_the_motion(run)
    assert run.meta.started == datetime(2026, 1, 31, 12, 0, 0, 500_000, tzinfo=UTC)


def test_parquet_with_dates_of_a_zone_where_clocks_are_set_back_meanwhile(tmp_path):
    began = pd.Timestamp("2026-10-25T00:59:58Z").tz_convert("Europe/Berlin")
    table = MOTION.assign(time=began + pd.to_timedelta(MOTION["time"] - 7000.0, unit="ms"))
    path = tmp_path / "log.parquet"
    table.set_index("time").to_parquet(path)  # as pandas keeps what is indexed by time
    run = brought(path, CLOCK.replace("ms", "datetime") + SIGNALS)
    assert holds_the_motion(run)
    assert run.meta.started == datetime(2026, 10, 25, 0, 59, 58, tzinfo=UTC)


def test_dates_in_words_and_counts_of_samples(tmp_path):
    stamps = pd.Timestamp("2026-01-31T12:00Z") + pd.to_timedelta(np.arange(len(MOTION)) * 2, "ms")
    path = as_csv(tmp_path, MOTION.assign(time=stamps.map(lambda s: s.isoformat())))
    assert holds_the_motion(brought(path, CLOCK.replace("ms", "datetime") + SIGNALS))
    (tmp_path / "counts").mkdir()
    path = as_csv(tmp_path / "counts", MOTION.assign(time=900 + np.arange(len(MOTION))))
    clock = '[time]\ncolumn = "time"\nunit = "samples"\nrate = 500\n'
    assert holds_the_motion(brought(path, clock + SIGNALS))


def test_nanoseconds_since_1970_keep_their_digits(tmp_path):
    ns = 1_769_860_800_000_000_000 + np.arange(len(MOTION), dtype=np.int64) * 2_000_001
    path = as_csv(tmp_path, MOTION.assign(time=ns))
    table = brought(path, CLOCK.replace("ms", "ns") + SIGNALS).table
    np.testing.assert_allclose(table["t"], np.arange(len(MOTION)) * 2.000001e-3, rtol=0, atol=1e-12)


def test_mat_variables_structs_and_columns_of_a_matrix(tmp_path):
    path = tmp_path / "log.mat"
    content = {
        "time": MOTION["time"].to_numpy()[:, None],
        "log": {
            "target": MOTION["target"].to_numpy(),
            "both": MOTION[["actual", "speed"]].to_numpy(),
        },
        "u": MOTION["force"].to_numpy()[None, :] / 7.5,
        "gain": 7.5,
    }
    scipy.io.savemat(path, content)
    signals = SIGNALS.replace('"target"', '"log.target"').replace('"actual"', '"log.both(:,1)"')
    signals = signals.replace('"speed"', '"log.both(:,2)"')
    signals = signals.replace('column = "force",', 'column = "u", times = ["gain"],')
    assert holds_the_motion(brought(path, CLOCK + signals))


def test_mat_elements_of_a_struct_array(tmp_path):
    path = tmp_path / "log.mat"
    blocks = np.empty(2, dtype=[("values", "O"), ("label", "O")])
    for k, column in enumerate(("target", "actual")):
        blocks[k] = (MOTION[column].to_numpy(), column)
    scipy.io.savemat(path, {"time": MOTION["time"].to_numpy(), "out": {"signals": blocks}})
    text = CLOCK + (
        '[signals]\n"axis.setpoint" = { column = "out.signals(1).values", unit = "mm" }\n'
        '"axis.position" = { column = "out.signals(2).values", unit = "mm" }\n'
    )
    table = brought(path, text).table
    np.testing.assert_allclose(table["axis.position"], 1e-3 * MOTION["actual"])


def write_mcap(path: Path) -> None:
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        schema = writer.register_schema("any", "jsonschema", b"{}")
        drive = writer.register_channel("/drive", "json", schema)
        goal = writer.register_channel("/goal", "json", schema)
        for row in MOTION.itertuples():
            ns = round(row.time * 1e6)
            state = {"x": [row.actual, row.speed], "f": {"kN": row.force}, "stamp": row.time}
            writer.add_message(drive, ns + 5_000, json.dumps(state).encode(), ns)
            writer.add_message(goal, ns, json.dumps({"target": row.target}).encode(), ns)
        writer.finish()


MCAP_SIGNALS = """
[signals]
"axis.setpoint" = { column = "/goal:target", unit = "mm" }
"axis.position" = { column = "/drive:x.0", unit = "mm" }
"axis.velocity" = { column = "/drive:x.1", unit = "mm/s" }
"axis.force" = { column = "/drive:f.kN", unit = "kN" }
"""


def test_mcap_stamps_each_topic_by_its_log_time(tmp_path):
    path = tmp_path / "log.mcap"
    write_mcap(path)
    run = brought(path, MCAP_SIGNALS)
    goals, answers = (run.table["t"][run.table[s].notna()] for s in ("axis.setpoint", "axis.force"))
    np.testing.assert_allclose(answers.to_numpy() - goals.to_numpy(), 5e-6, atol=1e-9)
    np.testing.assert_allclose(run.table["axis.force"].dropna(), 1e3 * MOTION["force"])


def test_mcap_by_a_time_inside_the_messages(tmp_path):
    path = tmp_path / "log.mcap"
    write_mcap(path)
    signals = "\n".join(line for line in MCAP_SIGNALS.splitlines() if "goal" not in line)
    table = brought(path, '[time]\ncolumn = "stamp"\nunit = "ms"\n' + signals).table
    np.testing.assert_allclose(table["t"], 1e-3 * (MOTION["time"] - 7000.0), atol=1e-9)


DBC = """
VERSION ""
NS_ :
BS_:
BU_: drive
BO_ 513 Answer: 8 drive
 SG_ Position : 0|32@1- (0.0001,0) [0|0] "mm" host
 SG_ Speed : 32|32@1- (0.0001,0) [0|0] "mm/s" host
BO_ 514 Force: 4 drive
 SG_ Force : 0|32@1- (0.000001,0) [0|0] "kN" host
BO_ 2147484177 Goal: 4 drive
 SG_ Target : 0|32@1- (0.0001,0) [0|0] "mm" host
"""
CAN_SIGNALS = """
[file]
dbc = "rig.dbc"

[signals]
"axis.setpoint" = { column = "Goal.Target", unit = "mm" }
"axis.position" = { column = "Answer.Position", unit = "mm" }
"axis.velocity" = { column = "Answer.Speed", unit = "mm/s" }
"axis.force" = { column = "Force.Force", unit = "kN" }
"""


def write_can(path: Path) -> None:
    (path.parent / "rig.dbc").write_text(DBC, encoding="utf-8")
    rules = cantools.database.load_string(DBC)
    with can.Logger(path) as log:
        for row in MOTION.itertuples():
            for name, values in (
                ("Goal", {"Target": row.target}),
                ("Answer", {"Position": row.actual, "Speed": row.speed}),
                ("Force", {"Force": row.force}),
            ):
                log.on_message_received(
                    can.Message(
                        timestamp=1.7698608e9 + 1e-3 * row.time,
                        arbitration_id=rules.get_message_by_name(name).frame_id,
                        is_extended_id=name == "Goal",
                        data=rules.encode_message(name, values),
                    )
                )
            if row.Index % 100 == 0:
                stray = can.Message(timestamp=1.7698608e9 + 1e-3 * row.time, arbitration_id=0x7F)
                log.on_message_received(stray)


@pytest.mark.parametrize("name", ["can.log", "can.blf", "can.asc"])
def test_can_logs_with_a_dbc(tmp_path, name):
    path = tmp_path / name
    write_can(path)
    report = bring(path, CAN_SIGNALS)
    run = load_run(Path(report.folder))
    resolution = {"can.log": 2e-6, "can.blf": 2e-6, "can.asc": 2e-6}[name]
    for signal, column, factor, quantum in (
        ("axis.setpoint", "target", 1e-3, 1e-4),
        ("axis.position", "actual", 1e-3, 1e-4),
        ("axis.force", "force", 1e3, 1e-6),
    ):
        there = run.table[signal].dropna()
        np.testing.assert_allclose(there, factor * MOTION[column], rtol=0, atol=factor * quantum)
    at = run.table["t"][run.table["axis.force"].notna()].to_numpy()
    np.testing.assert_allclose(np.diff(at), 0.002, rtol=0, atol=resolution)
    assert any("does not describe: 40 of 0x07F" in f.text for f in report.findings)


def test_zero_scale_offset_sign_and_other_columns(tmp_path):
    table = MOTION.assign(
        counts=32768.0 - 10.0 * MOTION["actual"], ratio=np.full(len(MOTION), 4.0), push=0.25
    )
    path = as_csv(tmp_path, table)
    text = CLOCK + (
        "[signals]\n"
        '"axis.position" = { column = "counts", zero = 32768, scale = 0.1, sign = -1, unit = "mm" }\n'
        '"axis.setpoint" = { column = "target", times = ["ratio"], scale = 0.25, offset = 1.5, '
        'unit = "mm", plus = [{ column = "push", divided_by = ["ratio"], scale = 16 }] }\n'
        '[extra]\ndrop = { column = "ratio", unit = "V" }\n'
    )
    run = brought(path, text)
    np.testing.assert_allclose(run.table["axis.position"], 1e-3 * MOTION["actual"], atol=1e-12)
    np.testing.assert_allclose(run.table["axis.setpoint"], 1e-3 * (MOTION["target"] + 2.5))
    extra = pd.read_parquet(run.path / "extra.parquet")
    assert list(extra) == ["t", "drop"]
    assert (extra["drop"] == 4.0).all()


def test_the_folder_says_where_it_comes_from(tmp_path):
    path = as_csv(tmp_path, MOTION)
    head = (
        'mode = "force"\nnote = "bench 3"\nrole = "reference"\npayload = { mass = 20, z = 0.2 }\n'
    )
    run = brought(path, CLOCK + SIGNALS, head)
    assert (run.meta.mode, run.meta.note, run.meta.role) == ("force", "bench 3", "reference")
    assert run.meta.payload is not None
    assert run.meta.payload.mass == 20.0
    kept = tomllib.loads((run.path / "run.toml").read_text())["imported"]
    assert kept["file"] == "log.csv"
    assert len(kept["sha256"]) == 64
    assert (run.path / "map.toml").read_bytes() == (tmp_path / "map.toml").read_bytes()
    assert run.rig == load_rig("axis")


def test_ten_times_the_rows_take_some_ten_times_as_long(tmp_path):
    took_s = []
    for rows in (100_000, 1_000_000):
        t = np.arange(rows) * 1e-3
        x = 0.1 * np.sin(0.7 * t) + 0.05 * np.sin(2.3 * t)
        path = tmp_path / str(rows) / "log.csv"
        path.parent.mkdir()
        table = pa.table(
            {"time": t, "target": x, "actual": x, "speed": np.gradient(x, 1e-3), "force": x}
        )
        pa.csv.write_csv(table, path)
        before = time.thread_time()
        report = bring(path, (CLOCK + SIGNALS).replace('"ms"', '"s"').replace("mm", "m"))
        took_s.append(time.thread_time() - before)
        assert report.rows == rows
    assert took_s[1] < 30.0 * took_s[0]


@pytest.mark.parametrize(
    "name", sorted(p.stem for p in (data_folder("configs") / "maps").glob("*"))
)
def test_every_shipped_map_is_found_by_its_name_and_loads(name):
    assert load_map(find_map(name)).signals


def test_the_command_prints_signals_and_checks_and_makes_the_folder(tmp_path):
    path = as_csv(tmp_path, MOTION)
    mapping = map_file(tmp_path, CLOCK + SIGNALS)
    arguments = ["runs", "import", str(path), "--map", str(mapping), "--out"]
    said = CliRunner().invoke(app, [*arguments, str(tmp_path / "a")])
    assert said.exit_code == 0, said.output
    assert "axis.position" in said.output
    assert "no warnings" in said.output
    as_json = CliRunner().invoke(app, [*arguments, str(tmp_path / "b"), "--json"])
    answer = json.loads(as_json.output)
    assert answer["rows"] == len(MOTION)
    assert {s["name"] for s in answer["signals"]} == {
        "axis.setpoint", "axis.position", "axis.velocity", "axis.force",
    }  # fmt: skip
    again = CliRunner().invoke(app, [*arguments, str(tmp_path / "a")])
    assert isinstance(again.exception, RunError)
    assert "never overwrites" in str(again.exception)


def test_an_import_that_the_disk_does_not_take_leaves_nothing_in_the_way(tmp_path, monkeypatch):
    def full(table, path, **how):
        path.write_bytes(b"PAR1")
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(pd.DataFrame, "to_parquet", full)
    path, mapping = as_csv(tmp_path, MOTION), map_file(tmp_path, CLOCK + SIGNALS)
    with pytest.raises(RunError, match="out: cannot be written: No space left on device"):
        import_run(path, mapping, tmp_path / "out")
    assert not list(tmp_path.glob("*out*"))
