"""`hil bicycle` from the command line: check, simulate, analyse, calibrate; the page needs nothing else."""

import json
import re

import numpy as np
import pytest
from typer.testing import CliRunner

from hil.bicycle.weave import SteerControl, model_weave
from hil.cli.bicycle import app, with_effects
from hil.configfile import load_bicycle
from hil.errors import ConfigError, RunError
from hil.rigs.bicycle import canonical, pack

run = CliRunner().invoke


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("rides") / "ride"
    result = run(app, ["simulate", str(path), "--track", "slalom", "--seed", "3"])
    assert result.exit_code == 0, result.output
    return path


def test_check_names_bodies_that_cannot_be():
    said = json.loads(run(app, ["check", "bicycle_text", "--json"]).stdout)
    assert [d.split(":")[0] for d in said["doubts"]] == ["mass.I4", "mass.I5"]
    assert said["stable_range"] is None
    assert "4.292 to 6.024 m/s" in run(app, ["check", "bicycle_benchmark"]).stdout


def test_analyse_writes_numbers_and_a_page_that_fetches_nothing(folder, tmp_path):
    page = tmp_path / "ride.html"
    result = run(app, ["analyse", str(folder), "--json", "--report", str(page)])
    assert result.exit_code == 0, result.output
    numbers = json.loads(result.stdout)
    assert numbers["distance_m"] == pytest.approx(100.0, abs=6.0)
    text = page.read_text()
    for heading in (
        "The ride",
        "Path",
        "Angular rates",
        "Accelerations",
        "Torques",
        "Forces on the road",
    ):
        assert heading in text
    outside = re.findall(
        r'(?:src|href)="(?!data:)[^"]+"', re.sub(r"<script>.*?</script>", "", text, flags=re.S)
    )
    assert outside == []
    assert '<canvas id="ride"' in text


def test_text_output_names_the_drift_by_cause(folder):
    said = run(app, ["analyse", str(folder), "--no-page"]).stdout
    assert "of that integration" in said
    assert "imu.gyro_y" in said


def test_effects_are_checked_by_name_and_bound():
    rig = load_bicycle("bicycle")
    changed = with_effects(
        rig, ["bicycle.front_suspension.stiffness=9000", "lean.sensor_bias.offset=0.01"]
    )
    assert [e.effect for e in changed.effects] == ["front_suspension", "sensor_bias"]
    for line, said in (
        ("bicycle.front_suspension.stifness=9", "front_suspension.stiffness"),
        ("bicycle.front_suspension.stiffness=soft", "is no number"),
        ("bicycle.front_suspension.stiffness=-3", "lies outside"),
    ):
        with pytest.raises(ConfigError, match=said):
            with_effects(rig, [line])


def test_a_run_without_a_bicycle_says_so(tmp_path):
    (tmp_path / "run.toml").write_text('format = "hil-run/1"\nrig = "bicycle"\nmode = "ride"\n')
    (tmp_path / "signals.csv").write_text("t,lean\n0.0,0.0\n0.01,0.0\n")
    result = run(app, ["analyse", str(tmp_path)])
    assert isinstance(result.exception, RunError)
    assert "name one with --rig" in str(result.exception)


def test_a_track_that_nobody_rides_is_named(tmp_path):
    result = run(app, ["simulate", str(tmp_path / "x"), "--track", "wheelie"])
    assert isinstance(result.exception, ConfigError)
    assert "u-turns, slalom" in str(result.exception)


def struck(folder):
    """Logs of a bicycle whose steer motor gives three quarters of what it is told, and their windows."""
    linear = canonical(pack(load_bicycle("bicycle_delft")))
    control = SteerControl(2.0, 6.5)
    windows = []
    for v in (2.0, 3.0, 4.0, 5.0):
        weave = model_weave(linear, v, control, near=-2.3 + 8.5j, motor=0.75)
        t = 0.01 * np.arange(120)
        rows = ["lean_rate,speed"]
        for k in range(2):
            swing = (0.3 + 0.1 * k) * np.exp(weave.real * t) * np.cos(weave.imag * t)
            rows += [f"{rate:.9f},{v}" for rate in swing.tolist()]
            windows.append(
                {"file": f"{v}.csv", "speed_mps": v, "start": 120 * k, "stop": 120 * (k + 1),
                 "p0": [-2.0, 8.0, 0.0, 0.3, 0.1], "set": "OFF"}
            )  # fmt: skip
        (folder / f"{v}.csv").write_text("\n".join(rows))
    (folder / "w.json").write_text(json.dumps(windows))


def test_weave_ranks_what_makes_a_struck_bicycle_differ(tmp_path):
    struck(tmp_path)
    words = [
        "weave",
        str(tmp_path / "w.json"),
        "--logs",
        str(tmp_path),
        "--gain",
        "2",
        "--top",
        "6.5",
    ]
    result = run(app, [*words, "--json"])
    assert result.exit_code == 0, result.output
    said = json.loads(result.stdout)
    causes = {c["cause"]: c for c in said["causes"]}
    assert causes["motor gain"]["values"]["motor"] == pytest.approx(0.75, abs=0.02)
    assert causes["motor gain"]["shrink"] > 0.9
    assert said["speed_gain"] == pytest.approx([1.0, 0.0], abs=1e-9)
    assert "frequency, rad/s" in run(app, words).stdout
    nothing = run(app, [*words, "--set", "ON"])
    assert "no window whose set ends with 'ON'" in str(nothing.exception)
