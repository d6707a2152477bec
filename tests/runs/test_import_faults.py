"""What is wrong with a log or its map is named by file, column and row; nothing is written then."""

from __future__ import annotations

import gzip
import lzma
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import scipy.io
from mcap.writer import Writer

from hil.configfile import rig_toml
from hil.errors import ConfigError, HilError, RunError
from hil.runs import load_run
from hil.runs.importing import find_map, import_run
from tests.runs.foreign import CLOCK, SIGNALS, as_csv, bring, found, map_file, motion
from tests.runs.test_import_formats import CAN_SIGNALS, MCAP_SIGNALS, write_can, write_mcap

ALL = CLOCK + SIGNALS


def refused(log: Path, text: str = ALL, kind: type[HilError] = RunError, head: str = "") -> str:
    """The sentence with which the import refuses; it leaves no folder behind."""
    with pytest.raises(kind) as error:
        bring(log, text, head)
    assert not (log.parent / "run").exists()
    return str(error.value)


def log_with(tmp_path: Path, **columns: object) -> Path:
    return as_csv(tmp_path, motion().assign(**columns))


def changed(column: str, rows: object, value: object) -> object:
    values = np.array(motion()[column], dtype=object)
    values[rows] = value
    return values


def test_messages_of_numbers_and_nests_beyond_all_bounds(tmp_path):
    log = tmp_path / "log.mcap"
    with log.open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        channel = writer.register_channel("/a", "json", 0)
        for k, text in enumerate(['{"x": 1}', "[" * 100_000, f'{{"x": {10**400}}}']):
            writer.add_message(channel, k, text.encode(), k)
        writer.finish()
    signal = '[signals]\n"axis.position" = { column = "/a:x", unit = "m" }\n'
    assert "/a:x, message 2: is not a finite number" in refused(log, signal)


# --- the map --------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ('"mm/s"', '"furlong/s"', "signals.axis.velocity.unit: is no unit that hil knows"),
        ("column = ", "colum = ", "signals.axis.setpoint.colum is not a key that hil knows"),
        ('unit = "ms"', 'unit = "samples"', 'unit "samples" needs a column and a rate'),
        ('unit = "ms"', 'unit = "fortnight"', "time.unit: input should be"),
        ('unit = "kN"', 'unit = "kN", scale = 0', "signals.axis.force.scale: must not be 0"),
        (
            'unit = "kN"',
            'unit = "kN", sign = 2',
            "signals.axis.force.sign: input should be 1 or -1",
        ),
    ],
)
def test_a_wrong_key_of_the_map_is_named(tmp_path, old, new, sentence):
    said = refused(as_csv(tmp_path, motion()), ALL.replace(old, new), ConfigError)
    assert "map.toml: " in said
    assert sentence in said


def test_a_unit_of_another_kind_is_refused_with_those_that_fit(tmp_path):
    text = ALL.replace('column = "force", unit = "kN"', 'column = "force", unit = "mm"')
    said = refused(as_csv(tmp_path, motion()), text)
    assert "signals.axis.force: is a force, which cannot be in 'mm'; it can be in N, kN" in said
    rotary = ALL.replace('"target", unit = "mm"', '"target", unit = "deg"')
    assert "signals.axis.setpoint: is a length" in refused(as_csv(tmp_path, motion()), rotary)


def test_a_signal_that_the_rig_has_not_is_refused_with_the_nearest(tmp_path):
    said = refused(as_csv(tmp_path, motion()), ALL.replace('"axis.position"', '"axi.position"'))
    assert "'axi.position' is no signal that the rig 'axis' has; is 'axis.position' meant?" in said


def test_a_map_that_is_not_there_names_those_that_are():
    with pytest.raises(ConfigError, match=r"those that come with hil are .*emps"):
        find_map("emsp")


def test_a_rig_file_of_another_name_is_refused(tmp_path, rig):
    other = tmp_path / "other.toml"
    other.write_text(rig_toml(rig), encoding="utf-8")
    log = as_csv(tmp_path, motion())
    with pytest.raises(RunError, match="is the rig 'motorcycle', the map is for 'axis'"):
        import_run(log, map_file(tmp_path, ALL), tmp_path / "run", str(other))


def test_an_unknown_rig_is_said_and_what_cannot_be_checked_then(tmp_path):
    report = bring(as_csv(tmp_path, motion()), ALL, rig="bench7")
    (said,) = found(report, "rig_file")
    assert said.startswith("warning bench7: no rig file of the name 'bench7'")


# --- the file -------------------------------------------------------------------------------------


def test_a_column_that_is_not_there_is_named_with_the_nearest(tmp_path):
    log = as_csv(tmp_path, motion().rename(columns={"actual": "actuals"}))
    said = refused(log)
    assert f"{log}: has no column 'actual'; nearest: actuals" in said


def test_topics_and_can_signals_that_are_not_there_are_named(tmp_path):
    log = tmp_path / "log.mcap"
    write_mcap(log)
    said = refused(log, MCAP_SIGNALS.replace("/drive:f.kN", "/drive:f.N"))
    assert "has no field '/drive:f.N'; nearest: /drive:f.kN" in said
    log = tmp_path / "can.blf"
    write_can(log)
    said = refused(log, CAN_SIGNALS.replace("Force.Force", "Force.Forces"))
    assert "rig.dbc: has no signal 'Force.Forces'; nearest: Force.Force" in said


def test_a_unit_against_the_dbc_is_refused(tmp_path):
    log = tmp_path / "can.log"
    write_can(log)
    said = refused(
        log, CAN_SIGNALS.replace('"Goal.Target", unit = "mm"', '"Goal.Target", unit = "m"')
    )
    assert "Goal.Target is in mm by the log's own description, the map says m" in said


def test_a_can_log_without_a_dbc_asks_for_one(tmp_path):
    log = tmp_path / "can.blf"
    write_can(log)
    assert "needs a DBC" in refused(log, ALL)


def test_mat_files_say_what_they_lack(tmp_path):
    log = tmp_path / "log.mat"
    log.write_bytes(b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM" + b"\x00" * 200)
    assert "version 7.3; save it with -v7" in refused(log)
    log.write_bytes(b"what is this")
    assert "cannot be read as a MAT file" in refused(log)


def test_files_that_are_none_are_named(tmp_path):
    assert "no such file" in refused(tmp_path / "nowhere.csv")
    log = tmp_path / "log.csv"
    log.write_text("", encoding="utf-8")
    assert f"{log}: is empty" in refused(log)
    log.write_bytes(bytes(range(256)))
    assert f"{log}: is no text in utf-8" in refused(log)
    log = tmp_path / "log.parquet"
    log.write_bytes(b"PAR1")
    assert "cannot be read as parquet" in refused(log)
    log = tmp_path / "log.csv.gz"
    log.write_bytes(gzip.compress(b"time,target\n1,2\n" * 50)[:40])
    assert f"{log}: cannot be read" in refused(log)


@pytest.mark.parametrize("encoding", ["latin-1", "utf-16"])
@pytest.mark.parametrize("row", [0, 900])
def test_a_log_in_another_encoding_says_which_key_of_the_map_names_it(tmp_path, encoding, row):
    log = as_csv(tmp_path, motion())
    lines = log.read_text(encoding="utf-8").splitlines()
    lines.insert(row, "# für Müller")
    log.write_text("\n".join(lines), encoding=encoding)
    said = refused(log, ALL, head='[file]\ncomment = "#"\n')
    assert f"{log}: is no text in utf-8" in said
    assert "encoding under [file] of the map" in said


@pytest.mark.parametrize(("ending", "pack"), [(".gz", gzip.compress), (".xz", lzma.compress)])
def test_a_packed_log_with_a_wrong_byte_is_named(tmp_path, ending, pack):
    log = tmp_path / f"log.csv{ending}"
    packed = bytearray(pack(motion().to_csv(index=False).encode()))
    packed[len(packed) // 2] ^= 0xFF
    log.write_bytes(packed)
    assert f"{log}: cannot be read" in refused(log)


@pytest.mark.parametrize("form", ["4", "5"])
def test_a_mat_file_with_wrong_bytes_is_named(tmp_path, form):
    log = tmp_path / "log.mat"
    table = {c: motion()[c].to_numpy() for c in motion()}
    scipy.io.savemat(log, table, format=form, do_compression=form == "5")
    content = bytearray(log.read_bytes())
    content[0 if form == "4" else len(content) // 2] ^= 0xFF
    log.write_bytes(content)
    assert f"{log}: cannot be read as a MAT file" in refused(log)


def test_a_row_with_a_cell_too_many_is_named_wherever_it_stands(tmp_path):
    log = as_csv(tmp_path, motion())
    lines = log.read_text().splitlines()
    lines[500] = lines[500].replace(",", ",1,", 1)  # a thousand with a comma, say
    log.write_text("\n".join(lines))
    assert "Expected 5 fields in line 501, saw 6" in refused(log)


def test_a_cell_that_is_no_number_is_named_by_column_and_row(tmp_path):
    log = log_with(tmp_path, force=changed("force", 700, "overload"))
    assert f"{log}: column force, row 701: 'overload' is not a finite number" in refused(log)
    log = log_with(tmp_path, time=changed("time", 41, "noon"))
    assert f"{log}: column time, row 42: 'noon' is not a finite number" in refused(log)


@pytest.mark.parametrize("cell", ["ERR", "1.5", "1,234.5"])
def test_a_cell_that_is_no_number_among_decimal_commas_is_named_by_its_own_row(tmp_path, cell):
    table = motion().map(lambda v: f"{v:.6f}".replace(".", ","))
    table.loc[300, "force"] = cell
    log = tmp_path / "log.csv"
    table.to_csv(log, index=False, sep=";")
    said = refused(log, '[file]\ndecimal = ","\n' + ALL)
    assert said == f"{log}: column force, row 301: '{cell}' is not a finite number"


@pytest.mark.parametrize("cell", ["#DIV/0!", "12#", "1.#INF", "3.5 # sic"])
def test_a_sign_of_comments_within_a_row_is_part_of_a_cell(tmp_path, cell):
    log = log_with(tmp_path, actual=changed("actual", 300, cell))
    assert f"{log}: column actual, row 301: '{cell}' is not a finite number" in refused(log)


@pytest.mark.parametrize(
    ("cell", "is_told"), [("#N/A", "is empty"), ("#DIV/0!", "is not a finite")]
)
def test_a_row_that_begins_with_what_a_sheet_could_not_reckon_is_no_comment(
    tmp_path, cell, is_told
):
    log = log_with(tmp_path, time=changed("time", 99, cell))
    said = refused(log)
    assert f"{log}: column time, row 100: " in said
    assert is_told in said


# --- clocks ---------------------------------------------------------------------------------------


def test_a_clock_that_runs_back_is_named_by_row(tmp_path):
    log = log_with(
        tmp_path, time=changed("time", slice(1000, None), 7000.0 + 2.0 * np.arange(3000))
    )
    said = refused(log)
    assert f"{log}: column time: time runs back at row 1001, from 8.998000 s to 7.000000 s" in said


def test_an_empty_stamp_is_named_by_row(tmp_path):
    log = log_with(tmp_path, time=changed("time", 99, ""))
    assert f"{log}: column time, row 100: is empty" in refused(log)


@pytest.mark.parametrize("row", [0, 7, -1])
def test_a_date_that_lacks_is_named_by_row(tmp_path, row):
    dates = pd.Timestamp("2026-01-31T12:00Z") + pd.to_timedelta(motion()["time"], unit="ms")
    dates.iloc[row] = pd.NaT
    log = tmp_path / "log.parquet"
    motion().assign(time=dates).to_parquet(log)
    place = f"column time, row {row % len(dates) + 1}: is empty"
    assert place in refused(log, ALL.replace('"ms"', '"datetime"'))


def test_equal_stamps_are_a_fault_unless_the_map_allows_the_last_of_them(tmp_path):
    table = motion()
    log = log_with(tmp_path, time=changed("time", 500, table["time"][499]))
    said = refused(log)
    assert "column time: rows 500 and 501 have the same stamp 0.998000 s (1 pairs in all)" in said
    report = bring(log, ALL, head='allow = ["duplicate_stamps"]')
    assert report.rows == len(table) - 1
    kept = load_run(Path(report.folder)).table
    assert kept["axis.position"][499] == pytest.approx(1e-3 * table["actual"][500])


def test_two_clocks_with_nothing_in_common_need_a_shift(tmp_path):
    log = log_with(tmp_path, drive_time=motion()["time"] / 1e3 + 3600.0)
    own = ', time = { column = "drive_time" } }'
    text = ALL.replace('"actual", unit = "mm" }', '"actual", unit = "mm"' + own)
    said = refused(log, text)
    assert "column drive_time: runs from 3607 to 3615 s, the clock time from 7 to 14.998 s" in said
    assert "they have no instant in common; give one of them a `shift`" in said
    shifted = text.replace('"drive_time" }', '"drive_time", shift = -3599.999 }')
    report = bring(log, shifted)
    assert [v.split()[0] for v in found(report, "clock_span")] == ["ok"]
    table = load_run(Path(report.folder)).table
    at = table["t"][table["axis.position"].notna()].to_numpy()
    np.testing.assert_allclose(at[:3], [0.001, 0.003, 0.005], atol=1e-9)
    (delay,) = found(report, "delay")
    assert "13.0" in delay


def test_a_clock_in_another_unit_than_the_other_is_refused(tmp_path):
    log = log_with(tmp_path, drive_time=motion()["time"] / 1e3)
    own = ', time = { column = "drive_time", unit = "ms", shift = 7.0 } }'
    said = refused(log, ALL.replace('"actual", unit = "mm" }', '"actual", unit = "mm"' + own))
    assert "is a unit of time wrong?" in said


def test_a_time_unit_that_cannot_be_is_said(tmp_path):
    report = bring(as_csv(tmp_path, motion()), ALL.replace('"ms"', '"s"'))
    (said,) = found(report, "time_unit")
    assert "a sample each 2 s is no log of motion: is its unit ms or finer?" in said


def test_stamps_off_the_rate_are_named(tmp_path):
    log = log_with(tmp_path, time=changed("time", 300, 7000.9))
    said = refused(log, ALL.replace("[time]", "[time]\nrate = 500"))
    assert "column time: time runs back at row 301" in said
    log = log_with(tmp_path, time=changed("time", 300, 7600.9))
    said = refused(log, ALL.replace("[time]", "[time]\nrate = 500"))
    assert "column time: row 301: its stamp 0.600900 s after the first lies 0.9 ms off" in said


def test_gaps_and_jitter_are_measured(tmp_path):
    table = motion()
    rng = np.random.default_rng(3)
    stamps = table["time"] + rng.uniform(-0.4, 0.4, len(table))
    stamps[2000:] += 350.0
    report = bring(log_with(tmp_path, time=stamps))
    (clock,) = found(report, "clock")
    # Differences of uniform stamps: sd 0.8/sqrt(12)*sqrt(2) ms.
    assert float(clock.split("jitter ")[1].split()[0]) == pytest.approx(0.327, abs=0.02)
    (gap,) = found(report, "gaps")
    assert gap.startswith("warning")
    assert "1 gaps, the longest 0.35" in gap
    assert "after row 2000" in gap


def in_turn():
    """Stamps of rows 2.2 and 7.8 ms apart: a setpoint, an answer, and the wait for the next cycle."""
    every = np.arange(len(motion()))
    return 10.0 * (every // 2) + 2.2 * (every % 2)


def test_signals_that_are_written_in_turn_leave_no_gaps(tmp_path):
    report = bring(log_with(tmp_path, time=in_turn()))
    assert not found(report, "gaps")
    (clock,) = found(report, "clock")
    assert "2.2 ms apart, 7.8 ms between turns" in clock
    assert "Hz" not in clock


def test_a_gap_between_turns_is_found(tmp_path):
    stamps = in_turn()
    stamps[2000:] += 350.0
    (gap,) = found(bring(log_with(tmp_path, time=stamps)), "gaps")
    assert "1 gaps, the longest 0.35" in gap


def test_rows_that_are_lost_now_and_then_are_gaps(tmp_path):
    table = motion()
    rng = np.random.default_rng(4)
    stamps = table["time"].to_numpy() + 10.0 * np.cumsum(rng.random(len(table)) < 0.03)
    (gap,) = found(bring(log_with(tmp_path, time=stamps)), "gaps")
    assert int(gap.split(" gaps")[0].rpartition(" ")[2]) > 50


def test_a_table_without_any_clock_asks_for_one(tmp_path):
    assert "give the map [time] column or rate" in refused(as_csv(tmp_path, motion()), SIGNALS)


def test_a_clock_that_stands_is_none(tmp_path):
    log = log_with(tmp_path, time=7000.0)
    assert "column time: every stamp is 7.000000 s: is it a clock?" in refused(log)


@pytest.mark.parametrize("clock", [CLOCK, "[time]\nrate = 500\n"])
def test_one_row_is_no_run(tmp_path, clock):
    assert "holds 1 rows, that is no run" in refused(
        as_csv(tmp_path, motion()[:1]), clock + SIGNALS
    )


def test_a_short_log_is_brought_in_without_delay_or_sign(tmp_path):
    report = bring(as_csv(tmp_path, motion()[:8]))
    assert report.rows == 8
    assert not found(report, "delay")


def test_a_cut_recording_is_read_as_far_as_it_goes_and_says_so(tmp_path):
    log = tmp_path / "log.mcap"
    write_mcap(log)
    log.write_bytes(log.read_bytes()[:-20_000])
    report = bring(log, MCAP_SIGNALS)
    assert "it has no end" in found(report, "log")[0]
    assert report.rows > 0


# --- signals --------------------------------------------------------------------------------------


def test_a_block_without_values_is_a_fault_unless_the_map_allows_it(tmp_path):
    log = log_with(tmp_path, force=changed("force", slice(1200, 1700), ""))
    said = refused(log)
    assert f"{log}: column force, rows 1201 to 1700: no value for 0.998 s" in said
    report = bring(log, ALL, head='allow = ["nan_block"]')
    assert found(report, "nan_block")[0].startswith("warning axis.force")
    assert load_run(Path(report.folder)).table["axis.force"].notna().sum() == 3500


def test_values_that_take_turns_are_no_blocks(tmp_path):
    table = motion()
    seldom = table["force"].where(np.arange(len(table)) % 20 == 0)
    report = bring(as_csv(tmp_path, table.assign(force=seldom)))
    assert not found(report, "nan_block")
    assert {s.name: s.samples for s in report.signals}["axis.force"] == len(table) // 20


def test_a_column_without_any_value_is_refused(tmp_path):
    said = refused(log_with(tmp_path, force=np.nan))
    assert "column force: holds no value at all" in said


def test_millimetres_called_metres_are_refused(tmp_path):
    said = refused(
        as_csv(tmp_path, motion()), ALL.replace('"target", unit = "mm"', '"target", unit = "m"')
    )
    assert "column axis.setpoint, from row" in said
    assert "far outside the stroke -0.25..0.25 m of the rig 'axis'" in said
    assert "millimetres" in said


@pytest.mark.parametrize(
    ("old", "new", "signal", "sentence"),
    [
        ('"force", unit = "kN"', '"force", unit = "N"', "axis.force", "are these kN, volts"),
        (
            '"actual", unit = "mm"',
            '"actual", unit = "um"',
            "axis.position",
            "m of a stroke of 0.5 m: is the map's unit, um, right?",
        ),
        (
            '"speed", unit = "mm/s"',
            '"speed", unit = "m/s"',
            "axis.velocity",
            "the drive's fastest is 0.375 m/s: is the map's unit, m/s, right?",
        ),
    ],
)
def test_sizes_that_no_drive_of_the_rig_has_are_said(tmp_path, old, new, signal, sentence):
    report = bring(as_csv(tmp_path, motion()), ALL.replace(old, new))
    assert any(f"warning {signal}" in v and sentence in v for v in found(report, "unit"))


def test_degrees_and_g_where_si_is_promised_are_said(tmp_path):
    table = motion()
    n = len(table)
    rng = np.random.default_rng(1)
    log = as_csv(
        tmp_path,
        table.assign(
            wx=150.0 * np.sin(np.arange(n) / 50.0),
            ax=rng.normal(0.0, 0.02, n),
            ay=rng.normal(0.0, 0.02, n),
            az=1.0 + rng.normal(0.0, 0.02, n),
        ),
    )
    text = CLOCK + "[signals]\n" + '"imu.gyro_x" = { column = "wx", unit = "rad/s" }\n'
    text += "".join(f'"imu.accel_{a}" = {{ column = "a{a}", unit = "m/s2" }}\n' for a in "xyz")
    said = " ".join(found(bring(log, text), "unit"))
    assert "are these deg/s" in said
    assert "specific force of 1 m/s² in the middle: is it in g?" in said


def test_a_position_that_runs_against_its_setpoint_is_refused(tmp_path):
    log = log_with(tmp_path, actual=-motion()["actual"])
    assert "column actual: runs against its setpoint target: give one of them sign = -1" in refused(
        log
    )


def test_the_delay_of_the_answer_is_measured(tmp_path):
    (said,) = found(bring(as_csv(tmp_path, motion())), "delay")
    assert said.startswith("ok axis.position: ")
    assert float(said.split(": ")[1].split()[0]) == pytest.approx(12.0, abs=0.1)


def test_an_answer_before_its_question_is_said(tmp_path):
    table = motion()
    log = as_csv(tmp_path, table.assign(target=table["actual"], actual=table["target"]))
    (said,) = found(bring(log), "delay")
    assert said.startswith("warning")
    assert "ms before its setpoint" in said
    assert "an answer before its question: is target really the setpoint" in said


@pytest.mark.parametrize("unit", ["s", "us"])
def test_a_delay_by_a_time_in_another_unit_is_not_called_ok(tmp_path, unit):
    report = bring(as_csv(tmp_path, motion()), ALL.replace('"ms"', f'"{unit}"'))
    (said,) = found(report, "delay")
    assert said.startswith("warning")
    assert "is the unit of time the one that the map says?" in said


def test_another_axis_is_said(tmp_path):
    t = motion()["time"] * 1e-3
    (said,) = found(bring(log_with(tmp_path, actual=50.0 * np.sin(3.1 * t**1.1 + 1.0))), "delay")
    assert "is it another axis" in said


def test_a_value_beyond_all_bounds_gets_no_delay_beyond_all_bounds(tmp_path):
    (said,) = found(bring(log_with(tmp_path, actual=changed("actual", 700, 1e30))), "delay")
    assert "does a value stand out by far?" in said
    assert " ms " not in said


def test_velocity_and_force_of_the_wrong_sign_are_said(tmp_path):
    table = motion()
    report = bring(as_csv(tmp_path, table.assign(speed=-table["speed"], force=-table["force"])))
    (velocity,) = found(report, "velocity_scale")
    assert "is -1 times the rate of actual" in velocity
    (force,) = found(report, "force_sign")
    assert "give it sign = -1" in force


def test_a_clipped_signal_is_said_and_a_resting_one_is_not(tmp_path):
    table = motion()
    level = 0.5 * table["force"].max()
    (said,) = found(
        bring(as_csv(tmp_path, table.assign(force=table["force"].clip(upper=level)))), "clipping"
    )
    assert f"column force: stays at its extreme {1e3 * level:.6g} N" in said


def test_rest_at_the_end_of_travel_is_not_called_clipped(tmp_path):
    table = motion()
    stopped = table.copy()
    # Smoothly into rest at the largest position, in encoder steps of 1 µm.
    s = np.clip((table["time"] - 7000.0) / 4000.0, 0.0, 1.0)
    rising = np.round(150.0 * (3.0 * s**2 - 2.0 * s**3), 3)
    stopped[["target", "actual"]] = np.column_stack([rising, rising])
    stopped["speed"] = np.gradient(rising, 2e-3)
    assert not found(bring(as_csv(tmp_path, stopped)), "clipping")


def test_a_signal_that_never_moved_is_said(tmp_path):
    said = found(bring(log_with(tmp_path, force=0.3)), "constant")
    assert "column force: never moved, it is 300 N throughout" in said[0]


def test_a_sound_log_gets_no_warning(tmp_path):
    report = bring(as_csv(tmp_path, motion()))
    assert {f.verdict for f in report.findings} == {"ok"}
