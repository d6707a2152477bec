"""The MPI platform through the whole daemon in simulated time: its filter is told from its runs."""

from __future__ import annotations

import json

import numpy as np
import pytest
from typer.testing import CliRunner

from hil.cli.identify import app
from hil.configfile import load_drive, load_rig, rig_toml
from hil.daemon.simulated import record_ride
from hil.drives.profile import LustProfile
from hil.identify.frequency.frf import analyse
from hil.runs import load_run
from hil.signals import Cue, TimedPose

PERIOD_S, PERIODS = 2.0, 4
LINES = np.array([1, 3, 5, 9, 13])
AHEAD_S = np.arange(0.0, 0.2, 0.01)


@pytest.fixture(scope="module")
def rig():
    return load_rig("stewart_pd")


@pytest.fixture(scope="module")
def runs(rig, tmp_path_factory):
    """Three realisations of a multisine in heave, each two periods to settle and two to measure."""
    omega = 2 * np.pi * LINES / PERIOD_S
    amplitudes = np.minimum(0.3 / omega**2, 0.05 / omega)
    folder = tmp_path_factory.mktemp("runs")
    profiles = {"lust_cdd3000": load_drive("lust_cdd3000", LustProfile)}
    paths = []
    for seed in (1, 2, 3):
        phases = np.random.default_rng(seed).uniform(0, 2 * np.pi, len(LINES))

        def pose(t, phases=phases):
            heave = float(np.sum(amplitudes * np.cos(omega * t + phases)))
            return (0.0, 0.0, heave, 0.0, 0.0, 0.0)

        cues = [
            Cue("test", k + 1, t, t + 0.002, tuple(TimedPose(d, pose(t + d)) for d in AHEAD_S))
            for k, t in enumerate(np.arange(0.0, PERIOD_S * PERIODS + 0.1, 0.02))
        ]
        paths.append(record_ride(rig, rig_toml(rig), profiles, cues, folder, seed=seed))
    return paths


@pytest.fixture(scope="module")
def analysis(rig, runs):
    return analyse([load_run(path) for path in runs], rig)


def test_ten_hertz_and_thirty_five_milliseconds_are_recovered_from_the_setpoints(analysis):
    found = analysis.fits["filter by setpoints"].parameters
    assert found["frequency"].value == pytest.approx(10.0, abs=0.1)
    assert found["damping"].value == pytest.approx(1.0, abs=0.01)
    assert found["delay"].value == pytest.approx(0.035, abs=2e-4)


def test_and_from_the_measured_pose_with_intervals_that_hold_them(analysis):
    """Friction and noise of a few short periods leave wide intervals; the slow lag is sharp."""
    fit = analysis.fits["filter by measured pose"]
    for name, truth in (("frequency", 10.0), ("damping", 1.0), ("delay", 0.035)):
        low, high = fit.parameters[name].interval
        assert low < truth < high, name
    assert fit.parameters["delay"].value == pytest.approx(0.035, abs=0.006)
    assert fit.low_frequency_delay_s == pytest.approx(0.035 + 2 / (2 * np.pi * 10.0), abs=0.003)


def test_the_whole_is_the_product_of_its_links(analysis):
    asked, drives = analysis.links["cue to setpoints"], analysis.links["setpoints to pose"]
    whole = analysis.response
    assert analysis.periods == (2, 2, 2)
    assert whole.hz == pytest.approx(LINES / PERIOD_S, rel=1e-5)
    product = asked.value * drives.value
    assert np.abs(whole.value - product) == pytest.approx(0.0, abs=float(3 * whole.std.max()))
    assert drives.value == pytest.approx(np.ones(len(LINES)), abs=0.4)


def test_the_command_line_says_it_and_writes_a_page(runs, tmp_path):
    page = tmp_path / "frf.html"
    names = [str(path) for path in runs]
    done = CliRunner().invoke(app, ["frf", *names, "--rig", "stewart_pd", "--report", str(page)])
    assert done.exit_code == 0, done.output
    assert "3 realisations of 2, 2, 2 periods" in done.output
    assert "filter by measured pose" in " ".join(done.output.replace("│", " ").split()) or (
        "measured" in done.output
    )
    text = page.read_text(encoding="utf-8")
    assert "cue.heave → heave" in text
    assert "http" not in text.split("</script>")[-1]  # nothing is fetched


def test_a_script_gets_json(runs):
    options = ["--rig", "stewart_pd", "--input", "cue.heave", "--output", "imu.accel_z", "--json"]
    done = CliRunner().invoke(app, ["frf", str(runs[0]), *options])
    assert done.exit_code == 0, done.output
    answer = json.loads(done.output)
    assert answer["format"] == "hil-frf/1"
    assert answer["response"]["unit"] == "m/s²/m"
    hz, gain = np.array(answer["response"]["hz"]), np.array(answer["response"]["gain_db"])
    # The accelerometer sees the acceleration of the heave: ω² times the response of the pose.
    assert gain[0] - 20 * np.log10((2 * np.pi * hz[0]) ** 2) == pytest.approx(0.0, abs=0.5)


def test_agard_of_a_run_that_is_no_sinusoid_is_refused_in_a_sentence(runs):
    done = CliRunner().invoke(app, ["agard", str(runs[0]), "--rig", "stewart_pd"])
    assert done.exit_code != 0
    assert "is no sinusoid" in str(done.exception)


def test_agard_without_runs_tells_the_excursions(tmp_path):
    page = tmp_path / "agard.html"
    done = CliRunner().invoke(
        app, ["agard", "--rig", "stewart_pd", "--json", "--report", str(page)]
    )
    assert done.exit_code == 0, done.output
    heave = json.loads(done.output)["excursions"][2]
    assert heave["high"] == pytest.approx(0.2435, abs=1e-3)
    assert "Excursion limits" in page.read_text(encoding="utf-8")


def test_steps_for_the_dynamic_threshold_are_written_as_a_cue_file(tmp_path):
    file = tmp_path / "steps.csv"
    done = CliRunner().invoke(app, ["agard-steps", "stewart_pd", str(file), "--sizes", "0.2,0.5"])
    assert done.exit_code == 0, done.output
    assert "heave" in file.read_text(encoding="utf-8")
    done = CliRunner().invoke(app, ["agard-steps", "stewart_pd", str(file), "--sizes", "fast"])
    assert done.exit_code == 2
