"""The report: its numbers against hand-made runs, and the page that shows them."""

from __future__ import annotations

import re
import shutil
import subprocess
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from hil.config import RigFile
from hil.configfile import load_rig
from hil.errors import RunError
from hil.rigs import build_rig
from hil.runs import Run, RunMeta
from hil.signals import Event
from hil.ui.report import run_report
from hil.ui.report_data import Series, drawn, thinned, view
from hil.ui.report_summary import summary_lines

T = np.arange(0.0, 20.0, 0.01)
LAG_S = 0.03

MakeRun = Callable[..., Run]


def roll(t: np.ndarray) -> np.ndarray:
    return 0.15 * np.sin(1.5 * t)


@pytest.fixture(scope="module")
def rig() -> RigFile:
    return load_rig("motorcycle")


@pytest.fixture
def make_run(rig: RigFile, tmp_path: Path) -> MakeRun:
    """A rig that follows its roll setpoint 30 ms late and otherwise perfectly."""
    manipulator = build_rig(rig)

    def legs(t: np.ndarray) -> np.ndarray:
        poses = np.stack([np.zeros_like(t), np.zeros_like(t), roll(t)], axis=1)
        return np.stack([manipulator.inverse(q) for q in poses])

    def make(*, with_states: bool = True, with_rig: bool = True, **changes: object) -> Run:
        columns = {"t": T, "cue.roll": roll(T) * 1.1}
        sent, got = legs(T), legs(T - LAG_S - rig.bus.answer_delay)
        for i, name in enumerate(rig.actuator_names):
            columns[f"{name}.setpoint"] = sent[:, i]
            columns[f"{name}.position"] = got[:, i]
            columns[f"{name}.force"] = 500.0 + 100.0 * i + 0.0 * T
        states = pd.DataFrame({"t": []})
        if with_states:
            states = pd.DataFrame(
                {
                    "t": T,
                    "state": np.where(T < 5.0, "ready", "engaged"),
                    "setpoint.yaw": 0.0 * T,
                    "setpoint.pitch": 0.0 * T,
                    "setpoint.roll": roll(T),
                    "lateness_s": np.where(np.arange(len(T)) == 7, 4e-3, 5e-5),
                    "overruns": 2,
                    "slot_use": 0.999,
                    "bus_load": 0.3,
                }
            )
        meta = RunMeta(rig="motorcycle", started=datetime(2026, 1, 31, 12, tzinfo=UTC))
        table = pd.DataFrame({**columns, **changes})
        events = (
            Event(1.0, "info", "engaged", "a client leads"),
            Event(7.5, "warning", "cue_limited", "roll <b>0.4</b> rad & more"),
        )
        return Run(tmp_path, meta, rig if with_rig else None, table, states, events)

    return make


def test_pose_and_error_are_those_of_the_late_rig(make_run: MakeRun) -> None:
    """Error of a sine followed `LAG_S` late: amplitude times 2 sin(ω LAG/2)."""
    shown = view(make_run())
    quantity = shown.coordinates[2]
    assert quantity.name == "roll"
    expected = np.degrees(roll(quantity.measured.t - LAG_S))
    assert quantity.measured.values == pytest.approx(expected, abs=1e-6)
    worst = np.degrees(0.15) * 2.0 * np.sin(0.5 * 1.5 * LAG_S)
    assert np.abs(quantity.error.values).max() == pytest.approx(worst, rel=0.01)


def test_run_of_others_without_states_gets_its_setpoint_from_the_actuators(
    make_run: MakeRun,
) -> None:
    with_states = view(make_run()).coordinates[2]
    without = view(make_run(with_states=False)).coordinates[2]
    at = without.setpoint.t[5:-5]
    expected = with_states.setpoint.at(at)
    assert without.setpoint.at(at) == pytest.approx(expected, abs=np.degrees(0.15 * 1.5 * 2e-3))


def test_run_that_was_given_forces_is_judged_by_the_pose_asked_for(
    make_run: MakeRun, rig: RigFile
) -> None:
    full = make_run()
    names = [f"{a}.setpoint" for a in rig.actuator_names]
    run = Run(full.path, full.meta, rig, full.table.drop(columns=names), full.states, ())
    for given, found in zip(view(full).actuators, view(run).actuators, strict=True):
        assert found.setpoint.values == pytest.approx(given.setpoint.values, abs=1e-6)


def test_summary_has_ten_lines_with_the_numbers(make_run: MakeRun) -> None:
    lines = summary_lines(make_run())
    assert len(lines) == 10
    text = dict(line.split(": ", 1) for line in lines)
    assert text["states"] == "ready 5.0 s → engaged 15.0 s"
    error = np.degrees(roll(T) - roll(T - LAG_S))
    rms, worst = np.sqrt(np.mean(error**2)), np.abs(error).max()
    assert text["pose error"].startswith("rms/max yaw 0.000/0.000 °, pitch 0.000/0.000 °, ")
    said = re.search(r"roll ([\d.]+)/([\d.]+) °$", text["pose error"])
    assert said is not None
    assert (float(said[1]), float(said[2])) == pytest.approx((rms, worst), abs=1e-3)
    assert text["force"] == "largest leg1 500 N (10 %), leg2 600 N (12 %), slide 700 N (23 %)"
    assert text["bus"].startswith("slot use 99.90 %, load 30% on average")
    assert "p50 50 µs" in text["loop"]
    assert "max 4000 µs; 2 overruns in 2000 cycles" in text["loop"]
    assert text["events"] == "1 warning, 1 info: cue_limited"
    assert text["limits"] == "none hit"


def test_limits_that_were_hit_are_named(make_run: MakeRun) -> None:
    force = np.where(T < 5.0, 5089.0, 0.0)
    stuck = np.where(T < 1.0, 0.9599, 0.6)
    run = make_run(**{"cue.roll": 3.0 * roll(T), "leg1.force": force, "leg2.position": stuck})
    limits = summary_lines(run)[9]
    assert re.search(r"cue roll beyond ±0.26 in \d\d\.\d% of its poses", limits)
    assert "leg1 at its largest force in 25.0% of its answers" in limits
    assert "leg2 within 4 mm of its stroke's end" in limits


def test_run_without_rig_or_states_still_has_ten_lines(make_run: MakeRun) -> None:
    lines = summary_lines(make_run(with_rig=False, with_states=False))
    assert len(lines) == 10
    assert "limits: unknown without a rig file" in lines
    assert any(line.startswith("actuator error: rms/max leg1") for line in lines)


@pytest.mark.parametrize("most", [3000, 100])
def test_no_line_is_drawn_where_there_are_no_samples(most: int) -> None:
    t = np.concatenate([np.arange(0.0, 5.0, 0.02), np.arange(9.0, 12.0, 0.02)])
    x, y = drawn(Series(t, np.cos(t)), most)
    assert x[np.isnan(y)] == pytest.approx([6.99])
    assert np.all(np.diff(x) > 0.0)


def test_thinned_curve_keeps_every_peak_that_a_screen_could_show() -> None:
    t = np.linspace(0.0, 600.0, 100_003)
    values = np.sin(t)
    values[54_321] = 9.0
    values[77_777] = -9.0
    few = thinned(Series(t, values), 3000)
    assert len(few.t) <= 3000
    assert (np.diff(few.t) > 0).all()
    assert (few.values.max(), few.values.min()) == (9.0, -9.0)
    assert (few.t[0], few.t[-1]) == (t[0], t[-1])
    short = Series(t[:100], values[:100])
    assert thinned(short, 3000) is short


def test_page_is_whole_and_fetches_nothing(make_run: MakeRun, tmp_path: Path) -> None:
    page = run_report(make_run(), tmp_path / "report.html").read_text(encoding="utf-8")
    assert page.count("plotly.js v") == 1
    assert re.search(r'<(script|link|img)[^>]*(src|href)="', page) is None
    assert "roll &lt;b&gt;0.4&lt;/b&gt; rad &amp; more" in page
    for line in ("pose error", "slot use 99.90 %", "lateness of the loop", "leg2"):
        assert line in page


def test_ten_minutes_make_less_than_five_megabytes_of_data(
    make_run: MakeRun, tmp_path: Path
) -> None:
    run = make_run()
    n = 60_000
    long = {c: np.resize(run.table[c].to_numpy(), n) for c in run.table.columns}
    rng = np.random.default_rng(0)
    long |= {f"imu.{q}_{a}": rng.normal(size=n) for q in ("gyro", "accel") for a in "xyz"}
    long["t"] = 0.01 * np.arange(n)
    states = pd.DataFrame({c: np.resize(run.states[c].to_numpy(), n) for c in run.states.columns})
    states["t"] = long["t"]
    ten = Run(run.path, run.meta, run.rig, pd.DataFrame(long), states, run.events)
    page = run_report(ten, tmp_path / "long.html")
    short = run_report(make_run(with_rig=False, with_states=False), tmp_path / "short.html")
    assert page.stat().st_size - short.stat().st_size < 4_000_000
    assert page.stat().st_size < 10_000_000


def test_page_that_cannot_be_written(make_run: MakeRun, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way of a folder")
    with pytest.raises(RunError, match="cannot be written"):
        run_report(make_run(), tmp_path / "file" / "report.html")


@pytest.mark.skipif(shutil.which("chromium") is None, reason="needs a browser")
def test_browser_draws_every_row(make_run: MakeRun, tmp_path: Path) -> None:
    page = run_report(make_run(), tmp_path / "report.html")
    browser = ["chromium", "--headless", "--no-sandbox", "--disable-gpu", "--dump-dom"]
    dom = subprocess.run(
        [*browser, "--virtual-time-budget=8000", page.as_uri()],
        capture_output=True,
        text=True,
        check=True,
        timeout=90,
    ).stdout
    assert dom.count('class="subplot ') >= 10
    assert dom.count('class="js-line"') >= 20
