"""`hil experiment` designs, shows, writes and plays; `hil rig workspace` says where a rig can go."""

import json
import re
from pathlib import Path

import pytest
from typer.testing import CliRunner

from hil.cli.app import app
from hil.cli.experiment import unit_of
from hil.cli.plan_options import options_of
from hil.configfile import load_rig
from hil.errors import ConfigError, RigNotReached
from hil.identify.experiments import experiment_of
from hil.identify.experiments.limits import Use
from hil.identify.experiments.plans import PLANS
from hil.runs import load_run
from hil.runs.folder import Payload

run = CliRunner().invoke
STEP = ["experiment", "axis", "step", "--count", "1", "--hold", "0.5"]


@pytest.mark.parametrize(
    "words",
    [
        ["step", "--amplitude", "1e6"],
        ["step", "--amplitude", "1e308"],
        ["sweep", "--f-min", "1e-9"],
        ["heave", "--frequency", "1e-9"],
        ["multisine", "--period", "600", "--periods", "1000"],
    ],
)
@pytest.mark.filterwarnings("ignore:overflow encountered")
def test_a_motion_that_nobody_lives_to_see_is_refused(words):
    result = run(app, ["experiment", "axis", *words])
    assert isinstance(result.exception, ConfigError)
    assert "at most 21600 s are played: is it asked for in m, rad and Hz?" in str(result.exception)


def test_a_dry_run_writes_motion_description_and_page_and_plays_nothing(tmp_path):
    result = run(app, [*STEP, "--dry-run", str(tmp_path / "out")], catch_exceptions=False)
    assert result.exit_code == 0
    assert {p.name for p in (tmp_path / "out").iterdir()} == {
        "experiment.toml",
        "experiment.csv",
        "experiment.html",
    }
    assert "step on axis: position 0.01" in result.output
    assert "velocity of position" in result.output
    for rule, unit in (("velocity of position", "m/s"), ("speed of axis", "m/s"),
                       ("acceleration of axis", "m/s²")):  # fmt: skip
        (line,) = (x for x in result.output.splitlines() if rule in x)
        assert line.split("│")[4].strip() == unit
    assert experiment_of(tmp_path / "out").played is None
    page = (tmp_path / "out" / "experiment.html").read_text()
    assert "Limits used" in page
    assert "<script src=" not in page


def test_limits_of_rotations_are_in_rad():
    rig = load_rig("motorcycle")
    assert unit_of(Use("jerk", "roll", 1.0, 2.0), rig) == "rad/s³"
    assert unit_of(Use("stroke", "leg1", 1.0, 2.0), rig) == "m"


def test_by_default_it_is_played_on_the_simulated_rig(tmp_path):
    result = run(app, [*STEP, "--runs", str(tmp_path), "--json", "--seed", "5"])
    assert result.exit_code == 0, result.output
    answer = json.loads(result.stdout)
    (folder,) = tmp_path.iterdir()
    assert answer["folder"] == str(folder)
    described = experiment_of(folder)
    assert described.played.seed == 5
    assert answer["experiment"]["played"]["start_s"] == described.played.start_s
    assert max(use["value"] / use["bound"] for use in answer["uses"]) < 0.6
    assert {use["unit"] for use in answer["uses"]} == {"m", "m/s", "m/s²", "m/s³"}
    position = load_run(folder).table["axis.position"].dropna()
    assert position.max() == pytest.approx(0.01, abs=5e-4)


def test_lists_are_given_with_commas(tmp_path):
    options = "--period 4 --periods 1 --realisations 1 --amplitude 0.01,0.02 --harmonics 1,2,5,6"
    lists = ["--coordinates", "pitch, roll", *options.split(), "--dry-run", str(tmp_path)]
    result = run(app, ["experiment", "motorcycle", "multisine", *lists], catch_exceptions=False)
    assert result.exit_code == 0
    described = experiment_of(tmp_path)
    assert described.amplitude == (0.01, 0.02)
    assert [lines.excited for lines in described.lines] == [(1, 5), (2, 6)]


def test_what_had_to_be_scaled_is_said(tmp_path):
    options = ["--amplitude", "0.5", "--cycles", "1", "--fade", "2", "--dry-run", str(tmp_path)]
    result = run(app, ["experiment", "axis", "heave", *options], catch_exceptions=False)
    assert "scaled by 0." in result.output
    assert "to fit: " in result.output


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (["step", "--hold", "0.01"], r"hil experiment axis step: hold_s: .*0\.1 \(got 0\.01\)"),
        (["sweep", "--coordinates", "heave"], r"axis has no coordinate 'heave'; it has position"),
        (["step", "--amplitude", "x"], r"amplitude\[0\]: .*valid number"),
        (["step", "--effect", "axis.backlash.gap"], r"--effect axis.backlash.gap: needs a name, ="),
        (["step", "--effect", "axis.backlsh.gap=1"], r"no parameter .*nearest: axis.backlash.gap"),
        (["step", "--effect", "axis.backlash.gap=1"], r"axis.backlash.gap = 1 m lies outside"),
        (["custom", "--file", "none.csv"], r"none.csv: no such file"),
    ],
)
def test_bad_options_get_a_sentence(options, says, tmp_path):
    result = run(app, ["experiment", "axis", *options, "--runs", str(tmp_path)])
    assert result.exit_code == 1
    assert isinstance(result.exception, Exception)
    with pytest.raises(type(result.exception), match=says):
        raise result.exception
    assert not list(tmp_path.iterdir())


def test_a_real_rig_cannot_be_hurt():
    result = run(
        app, [*STEP, "--endpoint", "tcp/127.0.0.1:9", "--effect", "axis.backlash.gap=0.001"]
    )
    assert isinstance(result.exception, ConfigError)
    assert "only a simulated rig can be hurt" in str(result.exception)


def test_an_endpoint_where_nobody_listens_is_named():
    result = run(app, [*STEP, "--endpoint", "tcp/127.0.0.1:9"])
    assert isinstance(result.exception, RigNotReached)
    assert "no daemon at tcp/127.0.0.1:9" in str(result.exception)


def test_a_custom_motion_is_played_from_its_file(tmp_path):
    path = tmp_path / "motion.csv"
    rows = [f"{0.01 * k},{0.01 * (1 - (k / 100 - 1) ** 2) ** 4}" for k in range(201)]
    path.write_text("t,position\n" + "\n".join(rows) + "\n")
    result = run(
        app,
        ["experiment", "axis", "custom", "--file", str(path), "--dry-run", str(tmp_path / "out")],
        catch_exceptions=False,
    )
    assert result.exit_code == 0
    described = experiment_of(tmp_path / "out")
    assert described.scale == 1.0
    assert len(described.plan.sha256) == 64


def test_a_custom_motion_is_played_again_from_where_it_was_written(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    rows = [f"{0.01 * k},{0.01 * (1 - (k / 100 - 1) ** 2) ** 4}" for k in range(201)]
    (tmp_path / "sub").mkdir()
    given = tmp_path / "sub" / "motion.csv"
    given.write_text("t,position\n" + "\n".join(rows) + "\n")
    asked = ["experiment", "axis", "custom", "--file", "sub/motion.csv", "--cutoff", "8"]
    run(app, [*asked, "--dry-run", "a"], catch_exceptions=False)
    given.unlink()
    for before, after in ("ab", "bc", "cc"):
        again = ["experiment", "axis", "play", f"{before}/experiment.toml", "--dry-run", after]
        run(app, again, catch_exceptions=False)
        assert experiment_of(after) == experiment_of("a")
        assert Path(after, "experiment.csv").read_bytes() == Path("a/experiment.csv").read_bytes()


def test_workspace_of_the_stewart_platform_is_the_published_one(tmp_path):
    """Specs: surge 930, sway 860, heave 500 mm; roll ±28, pitch +34/-32, yaw ±44 degrees."""
    page = tmp_path / "workspace.html"
    result = run(
        app, ["rig", "workspace", "stewart", "--json", "--html", str(page)], catch_exceptions=False
    )
    found = json.loads(result.stdout)
    spans = {c: r["to"] - r["from"] for c, r in found["ranges"].items()}
    assert [round(1e3 * spans[c]) for c in ("surge", "sway", "heave")] == pytest.approx(
        [930, 860, 500], abs=2
    )
    ends = {c: (57.29578 * r["from"], 57.29578 * r["to"]) for c, r in found["ranges"].items()}
    assert ends["pitch"] == pytest.approx((-32.0, 34.0), abs=0.15)
    assert ends["roll"] == pytest.approx((-28.0, 28.0), abs=0.1)
    assert ends["yaw"] == pytest.approx((-44.0, 44.0), abs=0.1)
    assert 0.40 < found["box_share"] < 0.55
    assert found["condition_neutral"] == pytest.approx(3.4, abs=0.05)
    assert not found["is_singular"]
    text = page.read_text()
    assert "Slices" in text
    assert "<script src=" not in text


def test_workspace_of_an_axis_is_a_table():
    result = run(app, ["rig", "workspace", "axis"], catch_exceptions=False)
    assert "-250.0" in result.output
    assert "100 % of the box" in result.output


def test_an_experiment_for_another_rig_is_not_played(tmp_path):
    assert run(app, [*STEP, "--dry-run", str(tmp_path)]).exit_code == 0
    again = [
        "experiment",
        "motorcycle",
        "play",
        str(tmp_path / "experiment.toml"),
        "--dry-run",
        "x",
    ]
    with pytest.raises(ConfigError, match="for the rig 'axis', not for 'motorcycle'"):
        run(app, again, catch_exceptions=False)


def test_an_experiment_is_played_again_with_the_payload_that_it_asks_for(tmp_path):
    asked = tmp_path / "asked"
    assert run(app, [*STEP, "--dry-run", str(asked)]).exit_code == 0
    again = ["experiment", "axis", "play", str(asked / "experiment.toml"), "--weighed"]
    with pytest.raises(ConfigError, match="asks for no payload"):
        run(app, again, catch_exceptions=False)
    text = (asked / "experiment.toml").read_text()
    (asked / "experiment.toml").write_text(
        text.replace("[plan]", "[payload]\nmass = 20.0\n\n[plan]", 1)
    )
    result = run(app, [*again, "--runs", str(tmp_path / "runs")], catch_exceptions=False)
    assert result.exit_code == 0, result.output
    (folder,) = (tmp_path / "runs").iterdir()
    assert load_run(folder).meta.payload == Payload(mass=20.0)
    assert "platform.payload_mass.mass=20.0" in experiment_of(folder).played.effects


@pytest.mark.parametrize("kind", PLANS)
def test_units_in_the_help_are_written_as_units(kind):
    told = [o.annotation.__metadata__[0].help for o in options_of(PLANS[kind])]
    assert all(len(text.split()) > 1 for text in told), "a unit alone says of nothing what it is"
    assert not [text for text in told if re.search(r"\bhz\b|^S\b", text)]


def test_excursion_limits_have_their_units():
    result = run(app, ["identify", "agard", "--rig", "axis"], catch_exceptions=False)
    assert "±0.22 m," in result.output
    assert "m/s, 10 m/s²" in result.output
