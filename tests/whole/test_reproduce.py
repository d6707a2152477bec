"""The papers again: experiments played through the daemon, read off as the paper does, on one page."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from typer.testing import CliRunner

from hil.cli.app import app
from hil.configfile import load_drive, load_rig
from hil.drives.profile import LustProfile
from hil.rigs import build_rig
from hil.ui.reproduce import FAST
from hil.ui.reproduce.bench import play_all
from hil.ui.reproduce.curves import Curve, Panel, panels
from hil.ui.reproduce.following import CASCADE, MODES, jobs, step_section, trace_of
from hil.ui.reproduce.report import write_report
from hil.ui.reproduce.stewart_fit import rotor_moments

PROFILES = {"lust_cdd3000": load_drive("lust_cdd3000", LustProfile)}


@pytest.fixture(scope="module")
def steps(tmp_path_factory):
    """The step of figure 5 in all four modes, each through the whole daemon."""
    asked = [j for j in jobs(load_rig("motorcycle"), FAST) if j.name.startswith("step_")]
    told: list[str] = []
    played = play_all(asked, PROFILES, tmp_path_factory.mktemp("runs"), told.append)
    assert len(told) == len(asked) == len(MODES)
    return played


def test_a_step_of_one_leg_reaches_its_centimetre_and_leaves_the_others_alone(steps):
    for name, played in steps.items():
        trace = trace_of(played)
        late = trace.measured_mm[(trace.t_s > trace.t_s[-1] - 0.5)]
        assert np.ptp(trace.wanted_mm) == pytest.approx(10.0, abs=1e-3), name
        assert np.abs(trace.error_mm).max() < 9.0
        assert np.std(late) < 0.1
        t, other = played.samples("leg2.position")
        wanted = played.lengths("leg2", t)
        assert np.ptp(wanted) < 1e-6
        assert np.abs(other - wanted).max() < 0.002


def test_figure_5_has_the_order_that_the_paper_reports(steps, tmp_path):
    section = step_section(steps)
    facts = {**section.facts, "of numpy": np.float64(1.0)}
    section = replace(section, facts=facts)
    assert facts["step_rms_torque_mm"] < 0.3 * facts["step_rms_servo_mm"]
    assert facts["step_rms_servo_mm"] < facts["step_rms_cascade_mm"]
    assert section.table is not None
    assert [row[0] for row in section.table.rows] == ["asked for", *(m.name for m in MODES)]
    errors = {t.name for t in section.pictures[0].data if t.xaxis == "x2"}
    assert CASCADE.name not in errors  # it would hide the others
    report = write_report(
        tmp_path / "page.html", "Again & again", "a paper", "<p>How</p>", [section]
    )
    page = report.path.read_text(encoding="utf-8")
    assert "Again &amp; again" in page
    assert "What the paper shows" in page
    assert f"{facts['step_rms_servo_mm']:.3f} mm" in page.replace("\n", " ")
    assert 'src="http' not in page  # nothing is fetched
    assert report.facts == facts
    assert {type(x) for x in report.facts.values()} == {float}  # so that --json can write them


def test_panels_share_one_legend_and_shade_bands_without_marks():
    x = np.linspace(0.0, 1.0, 50)
    curve = Curve("measured", x, x, "#2563eb", band=np.full(50, 0.1))
    figure = panels([Panel("a", "s", "m", [curve]), Panel("b", "s", "m", [curve])], columns=2)
    shown = [trace for trace in figure.data if trace.showlegend]
    assert [trace.name for trace in shown] == ["measured"]
    assert all(trace.mode == "lines" for trace in figure.data)


def test_what_rotors_add_to_the_moments_is_their_mass_carried_over_by_the_jacobian():
    rig = load_rig("stewart_pd")
    J = build_rig(rig).jacobian(np.zeros(6))
    masses = np.array([a.reflected_mass for a in rig.actuators])
    expected = np.diag(J.T @ np.diag(masses) @ J)[3:]
    assert rotor_moments(rig) == pytest.approx(expected, rel=1e-9)


def test_the_command_says_what_each_paper_is():
    done = CliRunner().invoke(app, ["reproduce", "--help"])
    assert done.exit_code == 0
    assert "motorcycle" in done.output
    assert "stewart" in done.output
