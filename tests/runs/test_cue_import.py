"""Measured rides become cue trajectories: maps, logs and cue files."""

from __future__ import annotations

import gzip
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from hil.config import RigFile
from hil.configfile import load_rig
from hil.control.trajectory import CueTrajectory, check, fit
from hil.errors import ConfigError, RunError
from hil.rigs import build_rig
from hil.runs import cue_from_log, read_cue_file, read_cue_map, write_cue_file
from tests.shared_data import shared

T = np.arange(0.0, 20.0, 0.01)


def column(rig: RigFile, name: str) -> int:
    return rig.coordinates.index(name)


def log(path: Path, **columns: object) -> Path:
    pd.DataFrame(columns).to_csv(path, index=False)
    return path


def test_map_in_one_line() -> None:
    found = read_cue_map("roll=lean_angle:deg*-0.5@2.5, pitch = speed : km/h, t=time:ms")
    roll, pitch = found.channel
    assert (roll.coordinate, roll.column, roll.kind, roll.low_pass_hz) == (
        "roll",
        "lean_angle",
        "angle",
        2.5,
    )
    assert roll.factor == pytest.approx(-0.5 * np.pi / 180.0)
    assert (pitch.kind, pitch.factor) == ("speed", pytest.approx(1.0 / 3.6))
    assert found.time is not None
    assert found.time.unit == "ms"


def test_map_in_toml_says_the_same(tmp_path: Path) -> None:
    path = tmp_path / "map.toml"
    path.write_text(
        'time = { column = "time", unit = "ms" }\n'
        '[[channel]]\ncoordinate = "roll"\ncolumn = "lean angle"\nunit = "rad"\nscale = 0.5\n'
        "low_pass_hz = 2.0\n"
    )
    in_line = read_cue_map("roll=lean angle:rad*0.5@2, t=time:ms")
    assert read_cue_map(str(path)) == in_line


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("", "names no coordinate; an example"),
        ("roll", "'roll' is not coordinate=column:unit"),
        ("roll=lean", "'roll=lean' is not coordinate=column:unit"),
        ("roll=lean:furlong", "'furlong' is no unit of a motion that hil knows: m, cm, mm"),
        ("roll=i:A", "'A' is no unit of a motion"),
        ("roll=lean:rad*", "is not coordinate=column:unit"),
        ("roll=lean:rad*1e", "could not convert"),
        ("roll=lean:rad*1e999", "scale must be finite"),
        ("roll=lean:rad@0", "low-pass above 0 Hz"),
        ("roll=speed:m/s", "is a speed, which can become pitch, surge, not 'roll'"),
        ("yaw=a:m/s2", "is an acceleration, which can become pitch, roll, surge"),
        ("roll=a:rad, t=time:h", "'h' is no unit of time"),
        ("roll=a:rad, t=time:s*2", "time is neither scaled nor filtered"),
        ("nowhere.toml", "cannot be read"),
    ],
)
def test_bad_map_gets_its_sentence(text: str, sentence: str) -> None:
    with pytest.raises(ConfigError) as caught:
        read_cue_map(text)
    assert sentence in str(caught.value)


def test_angle_is_the_pose_itself(tmp_path: Path, rig: RigFile) -> None:
    lean = 5.0 * np.sin(T)
    path = log(tmp_path / "a.csv", lean=lean)
    cue = cue_from_log(path, read_cue_map("roll=lean:deg*0.5"), rig, 100.0)
    roll = cue.trajectory.poses[:, column(rig, "roll")]
    assert roll == pytest.approx(np.radians(0.5 * lean), abs=1e-12)
    assert not cue.trajectory.poses[:, column(rig, "yaw")].any()
    assert cue.trajectory.t_s == pytest.approx(T)
    assert any("yaw, pitch: not in the map, kept at 0" in n for n in cue.notes)
    assert any("SHA-256" in n for n in cue.notes)


def test_low_pass_keeps_slow_motion_and_removes_fast(tmp_path: Path, rig: RigFile) -> None:
    """Butterworth of order 2, forwards and backwards: gain 1/(1 + (f/fc)^4), no delay."""
    slow, fast = np.sin(2 * np.pi * 0.2 * T), np.sin(2 * np.pi * 8.0 * T)
    path = log(tmp_path / "a.csv", lean=0.1 * (slow + fast))
    cue = cue_from_log(path, read_cue_map("roll=lean:rad@2"), rig, 100.0)
    middle = slice(300, -300)
    roll = cue.trajectory.poses[middle, column(rig, "roll")]
    assert roll == pytest.approx(0.1 * slow[middle], abs=0.1 * 0.008)


def test_steady_acceleration_becomes_the_tilt_that_gravity_makes_of_it(
    tmp_path: Path, rig: RigFile
) -> None:
    """Speeding up lifts the nose (pitch < 0); pushing left leans right (roll > 0): asin(a/g)."""
    path = log(tmp_path / "a.csv", ax=np.full_like(T, 0.6), ay=np.full_like(T, 0.4))
    cue = cue_from_log(path, read_cue_map("pitch=ax:m/s2*0.5, roll=ay:m/s2"), rig, 100.0)
    end = cue.trajectory.poses[-1]
    assert end[column(rig, "pitch")] == pytest.approx(-np.arcsin(0.3 / 9.81), rel=1e-3)
    assert end[column(rig, "roll")] == pytest.approx(np.arcsin(0.4 / 9.81), rel=1e-3)
    rate = np.abs(np.diff(cue.trajectory.poses, axis=0)).max() / 0.01
    assert rate <= np.radians(3.0) * 1.001


def test_speed_that_grows_evenly_tilts_like_its_acceleration(tmp_path: Path, rig: RigFile) -> None:
    path = log(tmp_path / "a.csv", v=3.6 * 0.5 * T)
    cue = cue_from_log(path, read_cue_map("pitch=v:km/h"), rig, 100.0)
    pitch = cue.trajectory.poses[:, column(rig, "pitch")]
    assert pitch[1000] == pytest.approx(-np.arcsin(0.5 / 9.81), rel=2e-3)


def test_channels_of_one_coordinate_add_up(tmp_path: Path, rig: RigFile) -> None:
    path = log(tmp_path / "a.csv", a=np.sin(T), b=np.cos(T))
    both = cue_from_log(path, read_cue_map("yaw=a:rad, yaw=b:rad*2"), rig, 100.0)
    yaw = both.trajectory.poses[:, column(rig, "yaw")]
    assert yaw == pytest.approx(np.sin(T) + 2.0 * np.cos(T))


def test_steady_turn_washes_out(tmp_path: Path, rig: RigFile) -> None:
    path = log(tmp_path / "a.csv", r=np.full_like(T, 0.2))
    cue = cue_from_log(path, read_cue_map("yaw=r:rad/s"), rig, 100.0)
    yaw = cue.trajectory.poses[:, column(rig, "yaw")]
    assert yaw.max() == pytest.approx(0.2 / np.e, rel=1e-2)  # t·exp(-t) peaks at 1/e
    assert abs(yaw[-1]) < 1e-4


def test_gaps_of_a_log_are_told(tmp_path: Path, rig: RigFile) -> None:
    t = np.where(T < 1.0, T, T + 0.5)
    path = log(tmp_path / "a.csv", t=t.tolist(), lean=np.sin(T).tolist())
    (note,) = [
        n for n in cue_from_log(path, read_cue_map("roll=lean:rad, t=t:s"), rig).notes if "gap" in n
    ]
    row = int(np.argmax(np.diff(t))) + 1
    assert note.startswith(
        f"1 gaps, the longest {0.5 + T[1] - T[0]:.3g} s after row {row}: nobody measured"
    )
    path = log(tmp_path / "b.csv", t=T.tolist(), lean=np.sin(T).tolist())
    notes = cue_from_log(path, read_cue_map("roll=lean:rad, t=t:s"), rig).notes
    assert not any("gap" in note for note in notes)


def test_uneven_time_column_is_resampled(tmp_path: Path, rig: RigFile) -> None:
    t = np.sort(T + np.random.default_rng(1).uniform(-0.004, 0.004, len(T)))
    path = log(tmp_path / "a.csv", ms=1000.0 * (t + 77.0), lean=np.sin(t))
    cue = cue_from_log(path, read_cue_map("roll=lean:rad, t=ms:ms"), rig)
    trajectory = cue.trajectory
    assert np.ptp(np.diff(trajectory.t_s)) < 1e-9
    expected = np.sin(trajectory.t_s + t[0])
    assert trajectory.poses[:, column(rig, "roll")] == pytest.approx(expected, abs=1e-4)


@pytest.mark.parametrize("name", ["a.csv", "a.log.gz", "a.parquet", "semicolon.csv"])
def test_every_kind_of_table_reads_the_same(tmp_path: Path, rig: RigFile, name: str) -> None:
    table = pd.DataFrame({"x": np.sin(T), "lean": np.cos(T)})
    path = tmp_path / name
    if name.endswith("parquet"):
        table.to_parquet(path)
    elif name.startswith("semicolon"):
        path.write_text("# made by hand\n" + table.to_csv(index=False, sep=";"))
    else:
        table.to_csv(path, index=False)
    cue = cue_from_log(path, read_cue_map("roll=lean:rad"), rig, 100.0)
    assert cue.trajectory.poses[:, column(rig, "roll")] == pytest.approx(np.cos(T), abs=1e-12)


@pytest.mark.parametrize(
    ("columns", "text", "rate_hz", "sentence"),
    [
        ({"lean": [1.0, 2.0]}, "roll=lean:rad", None, "say when its rows were taken"),
        ({"lean": [1.0, 2.0]}, "roll=bank:rad", 100.0, "has no column 'bank'; nearest: lean"),
        ({"lean": [1.0, "x"]}, "roll=lean:rad", 100.0, "column lean, row 2: 'x' is not a finite"),
        ({"lean": [None, 2.0]}, "roll=lean:rad", 100.0, "column lean, row 1: is empty"),
        ({"lean": [1.0]}, "roll=lean:rad", 100.0, "has 1 rows, that is no ride"),
        (
            {"a": [1, 2], "s": [1, 0]},
            "roll=a:rad, t=s:s",
            None,
            "column s: time runs back at row 2",
        ),
        ({"a": [1, 2]}, "sway=a:m", 100.0, "the rig 'motorcycle' has only yaw, pitch, roll"),
        (
            {"a": [0.0] * 50},
            "roll=a:rad@60",
            100.0,
            "a.csv: column a: cut-off 60 Hz lies outside 0..50 Hz",
        ),
        (
            {"a": [0.0] * 50, "ms": [10.0 * k for k in range(50)]},
            "roll=a:rad@2, t=ms:s",
            None,
            "a.csv: column ms: a row each 10 s is no ride: the map says s, is its unit ms or finer?",
        ),
        (
            {"a": [0.0] * 50, "ms": [10.0 * k for k in range(50)]},
            "roll=a:rad, t=ms:us",
            None,
            "a.csv: column ms: a row each 1e-05 s is no ride: the map says us, is its unit coarser?",
        ),
        (
            {"a": [0.0] * 50, "s": [0.01 * k + 1.7e9 * (k > 19) for k in range(50)]},
            "roll=a:rad, t=s:s",
            None,
            "a.csv: column s: 1.7e+09 s without a row after row 20: two rides, or a clock that was set",
        ),
        (
            {"a": [0.0] * 50},
            "roll=a:rad",
            np.inf,
            "a.csv: a row each 0 s is no ride: is its rate inf Hz?",
        ),
        (
            {"a": [0.0] * 50},
            "roll=a:rad",
            np.nan,
            "a.csv: a row each nan s is no ride: is its rate nan",
        ),
        ({"a": [0.0] * 50}, "roll=a:rad@1e-9", 100.0, "column a: cut-off 1e-09 Hz is too low"),
        (
            {"a": [0.0] * 50, "ms": [1.0 * k for k in range(50)]},
            "roll=a:rad@2, t=ms:s",
            None,
            "column a: cut-off 2 Hz lies outside 0..0.5 Hz of a trajectory sampled at 1 Hz; is its time, ms, "
            "really in s?",
        ),
    ],
)
def test_bad_log_gets_its_sentence(
    tmp_path: Path,
    rig: RigFile,
    columns: dict[str, list[object]],
    text: str,
    rate_hz: float | None,
    sentence: str,
) -> None:
    path = log(tmp_path / "a.csv", **columns)
    with pytest.raises(RunError) as caught:
        cue_from_log(path, read_cue_map(text), rig, rate_hz)
    assert sentence in str(caught.value)


def test_decimal_commas_are_read_where_the_map_says_so_and_named_where_it_does_not(
    tmp_path: Path, rig: RigFile
) -> None:
    lean = np.round(0.1 * np.cos(T), 6)
    path = tmp_path / "a.csv"
    pd.DataFrame({"t": T, "lean": lean}).to_csv(path, index=False, sep=";", decimal=",")
    with pytest.raises(
        RunError, match=r'a\.csv: column t, row 1: .* say decimal = "," under \[file\]'
    ):
        cue_from_log(path, read_cue_map("roll=lean:rad, t=t:s"), rig)
    cue_map = tmp_path / "map.toml"
    cue_map.write_text(
        'time = { column = "t" }\nfile = { decimal = "," }\n'
        '[[channel]]\ncoordinate = "roll"\ncolumn = "lean"\nunit = "rad"\n'
    )
    cue = cue_from_log(path, read_cue_map(str(cue_map)), rig)
    assert cue.trajectory.poses[:, column(rig, "roll")] == pytest.approx(lean)
    path.write_text("t,lean\n0,00,0,5\n0,01,0,6\n")
    with pytest.raises(RunError, match=r"a\.csv: row 1: has 4 cells, the first line names 2"):
        cue_from_log(path, read_cue_map("roll=lean:rad, t=t:s"), rig)


@pytest.mark.parametrize("content", [b"", b"\xff\xfe\x00\x81", b"a,b\n1,2,3\n1\n"])
def test_what_is_no_table_gets_its_sentence(tmp_path: Path, rig: RigFile, content: bytes) -> None:
    path = tmp_path / "a.csv"
    path.write_bytes(content)
    with pytest.raises(RunError, match=r"a\.csv"):
        cue_from_log(path, read_cue_map("roll=a:rad"), rig, 100.0)
    squeezed = tmp_path / "a.csv.gz"
    squeezed.write_bytes(gzip.compress(b"a\n" + b"1\n" * 5000)[:20])
    with pytest.raises(RunError, match="cannot be read"):
        cue_from_log(squeezed, read_cue_map("roll=a:rad"), rig, 100.0)
    with pytest.raises(RunError, match="no such file"):
        cue_from_log(tmp_path / "b.csv", read_cue_map("roll=a:rad"), rig, 100.0)


def test_cue_file_keeps_motion_rig_and_provenance(tmp_path: Path) -> None:
    poses = np.random.default_rng(0).normal(size=(len(T), 3))
    trajectory = CueTrajectory(("yaw", "pitch", "roll"), T, poses)
    write_cue_file(tmp_path / "c.csv", trajectory, "motorcycle", ["from a.log\nover two lines"])
    text = (tmp_path / "c.csv").read_text()
    assert text.startswith(
        "# hil-cue/1\n# rig: motorcycle\n# from a.log over two lines\nt,yaw,pitch,roll\n"
    )
    read = read_cue_file(tmp_path / "c.csv")
    assert (read.rig, read.notes) == ("motorcycle", ("from a.log over two lines",))
    assert read.trajectory.coordinates == trajectory.coordinates
    assert read.trajectory.poses == pytest.approx(poses, rel=1e-8)
    assert read.trajectory.t_s == pytest.approx(T)


@pytest.mark.parametrize(
    ("content", "sentence"),
    [
        ("# hil-cue/2\nt,roll\n0,0\n1,0\n", "format is 'hil-cue/2'"),
        ("roll\n0\n1\n", "has no column 't'"),
        ("t,roll\n0,0\n0,1\n", "column t: time stands still at row 2"),
        ("t,roll\n0,0\n1,\n", "column roll, row 2: is empty"),
        ("t,roll\n0,0\n1,high\n", "column roll, row 2: 'high' is not a finite number"),
        ("t,roll\n0,0\n1,1.#INF\n", "column roll, row 2: '1.#INF' is not a finite number"),
        ("t,roll\n0,0\n1,-1e300\n", "column roll, row 2: -1e+300 is beyond 1e+100"),
        ("t,roll\n0,0\n", "holds 1 poses of 1 coordinates"),
        ("t\n0\n1\n", "holds 2 poses of 0 coordinates"),
        ("\ufeff# hil-cue/2\nt,roll\n0,0\n1,0\n", "format is 'hil-cue/2'"),
        ("", "is no table of separated values"),
        ("t,roll\n0,0\n1,1,5\n", "is no table of separated values"),
        ("t,yaw,roll\n9,0,0,1\n9,1,1,2\n", "is no table of separated values"),
    ],
)
def test_bad_cue_file_gets_its_sentence(tmp_path: Path, content: str, sentence: str) -> None:
    path = tmp_path / "c.csv"
    path.write_text(content)
    with pytest.raises(RunError) as caught:
        read_cue_file(path)
    assert sentence in str(caught.value)
    assert str(path) in str(caught.value)


@pytest.mark.shared
def test_whole_bicycle_ride_fits_the_motorcycle_rig(tmp_path: Path, rig: RigFile) -> None:
    """Lean, acceleration and speed of a measured 18 km/h ride, all 145 s of it, inside the limits."""
    path = shared("data/sbw_bicycle/logs/eigen_normal_sil6.5n2_18kph.log.gz")
    cue_map = read_cue_map(
        "roll=lean_angle:rad@3, pitch=x_acceleration:m/s2*0.5@5, pitch=speed:m/s*0.5"
    )
    cue = cue_from_log(path, cue_map, rig, 100.0)
    with gzip.open(path, "rt") as stream:
        raw = pd.read_csv(stream)
    assert len(cue.trajectory.t_s) == len(raw) == 14558
    manipulator = build_rig(rig)
    assert check(cue.trajectory, rig, manipulator), "the raw ride is too fast for this rig"
    fitted = fit(cue.trajectory, rig, manipulator)
    assert not check(fitted.trajectory, rig, manipulator)
    assert any(note.startswith("roll: scaled by") for note in fitted.notes)
    roll = fitted.trajectory.poses[:, column(rig, "roll")]
    assert np.corrcoef(roll, raw["lean_angle"])[0, 1] > 0.98
    write_cue_file(tmp_path / "ride.csv", fitted.trajectory, rig.name, cue.notes + fitted.notes)
    again = read_cue_file(tmp_path / "ride.csv")
    assert not check(again.trajectory, rig, manipulator)


def test_map_of_another_rig_moves_its_own_coordinates(tmp_path: Path) -> None:
    stewart = load_rig("stewart")
    path = log(tmp_path / "a.csv", ax=np.sin(0.5 * T), z=0.02 * np.sin(T))
    cue = cue_from_log(path, read_cue_map("surge=ax:m/s2, heave=z:m"), stewart, 100.0)
    surge = cue.trajectory.poses[:, column(stewart, "surge")]
    assert np.abs(surge).max() > 0.01
    heave = cue.trajectory.poses[:, column(stewart, "heave")]
    assert heave == pytest.approx(0.02 * np.sin(T))
