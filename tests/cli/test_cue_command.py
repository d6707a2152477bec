"""`hil cue from-log` turns a measured ride into one that the rig can ride, and says what it changed."""

import json

import numpy as np
import pytest
from typer.testing import CliRunner

from hil.cli.app import app
from hil.cli.cue import file_cues
from hil.configfile import load_rig
from hil.errors import ConfigError, RunError
from tests.daemon.simulated_rig import Session, rig_file
from tests.shared_data import shared

run = CliRunner().invoke


FROM_LOG = ["cue", "from-log", "--map", "roll=lean:deg, t=time:s"]


def written(tmp_path, lean_deg=20.0, seconds=6.0):
    t = np.arange(0.0, seconds, 0.01)
    lean = lean_deg * np.sin(2.0 * np.pi * 0.5 * t) * np.hanning(t.size)
    log = tmp_path / "ride.csv"
    rows = "\n".join(f"{a:.3f},{b:.5f}" for a, b in zip(t, lean, strict=True))
    log.write_text(f"time,lean\n{rows}\n")
    return log


def test_what_is_too_much_is_scaled_and_said(tmp_path):
    out = tmp_path / "cue.csv"
    result = run(
        app,
        [*FROM_LOG, str(written(tmp_path)), "--out", str(out), "--json"],
    )
    assert result.exit_code == 0, result.output
    said = json.loads(result.output)
    assert said["factors"]["roll"] < 0.9
    assert any(note.startswith("roll: scaled by") for note in said["notes"])
    session = Session()
    session.arm()
    start_s = session.now_s
    for cue in file_cues(session.rig, out):
        session.cue(
            type(cue)(
                cue.client, cue.seq, cue.t_client_s + start_s, cue.received_s + start_s, cue.poses
            )
        )
    assert session.core.state == "engaged"
    assert not any(name.startswith("cue_") for name in session.events())


def test_the_measured_ride_is_not_overwritten_by_its_cues(tmp_path):
    log = written(tmp_path)
    measured = log.read_bytes()
    result = run(app, [*FROM_LOG, str(log), "--out", str(tmp_path / "." / "ride.csv")])
    assert isinstance(result.exception, RunError)
    assert "ride.csv: is the log itself" in str(result.exception)
    assert log.read_bytes() == measured


def test_a_cue_file_of_another_rig_is_refused(tmp_path):
    out = tmp_path / "cue.csv"
    args = ["cue", "from-log", str(written(tmp_path, 2.0)), "--map", "roll=lean:deg, t=time:s"]
    assert run(app, [*args, "--out", str(out)]).exit_code == 0
    with pytest.raises(ConfigError, match="axis has position"):
        file_cues(rig_file("axis"), out)


def test_a_cue_file_beyond_the_limits_is_refused_and_can_be_made_to_fit(tmp_path):
    rig = load_rig("motorcycle")
    limits = dict(zip(rig.coordinates, rig.limits, strict=True))
    file, fitted = tmp_path / "cue.csv", tmp_path / "fitted.csv"
    file.write_text("t,yaw,pitch,roll\n0,0,0,0\n" + f"1,0,0,{-limits['roll']}\n2,0,0,0\n")
    assert sum(1 for _ in file_cues(rig, file)) == 101
    t = np.arange(0.0, 6.0, 0.01)
    table = np.column_stack([t, 0.0 * t, 0.0 * t, -30.0 * np.sin(t)])
    np.savetxt(file, table, delimiter=",", header="t,yaw,pitch,roll", comments="")
    with pytest.raises(ConfigError, match=r"cue.csv: roll goes to -?30, the rig motorcycle to ±"):
        file_cues(rig, file)
    result = run(
        app, ["cue", "from-log", str(file), "--map", "roll=roll:deg, t=t:s", "-o", str(fitted)]
    )
    assert result.exit_code == 0, result.output
    assert sum(1 for _ in file_cues(rig, fitted)) == 300


def test_a_map_that_names_no_column_says_which_there_are(tmp_path):
    args = ["cue", "from-log", str(written(tmp_path)), "--map", "roll=tilt:deg, t=time:s"]
    result = run(app, [*args, "--out", str(tmp_path / "cue.csv")])
    assert result.exit_code != 0
    assert "tilt" in str(result.exception)


def test_a_low_pass_that_cannot_be_names_the_log_and_asks_for_the_unit_of_time(tmp_path):
    with pytest.raises(RunError, match=r"ride\.csv: cut-off 80 Hz .* is its time in the unit"):
        run(
            app,
            [
                *FROM_LOG,
                str(written(tmp_path)),
                "--out",
                str(tmp_path / "c.csv"),
                "--low-pass",
                "80",
            ],
            catch_exceptions=False,
        )


@pytest.mark.shared
def test_a_measured_bicycle_ride_fits_the_rig(tmp_path):
    log = shared("data/sbw_bicycle/logs/eigen_normal_sil6.5n2_10.8kph.log.gz")
    out = tmp_path / "cue.csv"
    chosen = "roll=lean_angle:rad*0.6@3, pitch=x_acceleration:m/s2@2, yaw=fork_angle:rad*0.5@3"
    args = ["cue", "from-log", str(log), "--map", chosen, "--rate", "100", "--out", str(out)]
    assert run(app, args).exit_code == 0
    values = np.loadtxt(out, delimiter=",", comments=("#", "t"))
    assert np.all(np.abs(values[:, 1:]) <= load_rig("motorcycle").limits)
