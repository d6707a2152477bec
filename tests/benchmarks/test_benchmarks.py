"""The figures can be measured, and who wins wins: costs are compared within one run only."""

from __future__ import annotations

import json
import math
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from benchmarks.figure import Options, Table
from benchmarks.parts import Part, measured

from benchmarks import loop_lateness, operation, rigs_vs_pinocchio, sim_vs_mujoco, tracking
from hil.drives.lust_cdd3000.codec import Mode, from_wire

QUICK = Options(quick=True)


def test_a_table_prints_and_becomes_json():
    table = Table("costs", ("µs", "who"), {"a": (12.3456, "x"), "b": (math.nan, "y")})
    assert table.text().splitlines() == ["costs", "     µs  who", "a  12.3    x", "b     -    y"]
    assert json.loads(json.dumps(table.as_json()))["rows"]["b"] == {"µs": None, "who": "y"}
    with pytest.raises(ValueError, match="has 1 of 2"):
        Table("costs", ("µs", "who"), {"a": (1.0,)})


def test_a_long_measurement_goes_on_where_it_was_ended(tmp_path: Path):
    taken = []

    def row(name: str, value: float) -> Part:
        def take():
            taken.append(name)
            return (value,)

        return Part(name, blank, f"row {name}", take)

    blank = Table("figures", ("µs",), {}, "as they are")
    parts = [row("real-a", 1.0), row("real-b", math.nan), row("cost", 3.0)]
    kept = tmp_path / "rows.json"
    (part,) = measured(parts, Options(save=kept, parts=("real-b",)))
    assert (list(part.rows), taken) == (["row real-b"], ["real-b"])
    (whole,) = measured(parts, Options(save=kept))
    assert (list(whole.rows), taken) == (
        ["row real-a", "row real-b", "row cost"],
        ["real-b", "real-a", "cost"],
    )
    assert math.isnan(whole.rows["row real-b"][0])
    with pytest.raises(SystemExit, match="no part 'real-c'; there are real-a, real-b, cost"):
        measured(parts, Options(parts=("real-c",)))


def test_pre_control_reaches_the_drives_and_its_absence_too():
    for mode, share in ((tracking.MODES[0], 0.0), (tracking.MODES[1], 1.0)):
        session = tracking.session_of(mode)
        ahead = mode.profiles()["lust_cdd3000"].parameters.precontrol
        for drive in session.simulated.drives:
            for parameter in (ahead.velocity, ahead.acceleration, ahead.friction):
                answer = drive.parameters.answer(parameter.number, Mode.READ, 0, enabled=True)
                assert answer is not None
                assert from_wire(parameter.type, answer[1]) * parameter.scale == share


def test_step_figures_of_a_known_step():
    """First order, 50 ms: rises in ln 9 and settles within 2 % after ln 50 time constants."""
    t = np.arange(-0.1, 1.0, 0.002)
    y = np.where(t >= 0.0, tracking.STEP_M * (1.0 - np.exp(-np.maximum(t, 0.0) / 0.05)), 0.0)
    rise, settled, overshoot, rms, worst = tracking.step_figures(tracking.Trace(t, y + 1e-4, y))
    assert rise == pytest.approx(50.0 * math.log(9.0), rel=0.01)
    assert settled == pytest.approx(50.0 * math.log(50.0), abs=2.0)
    assert overshoot == 0.0
    assert rms == pytest.approx(0.1)
    assert worst == pytest.approx(0.1)


def test_the_response_of_a_known_filter_is_found():
    """Second-order low pass, 8 Hz, damping 0.7, through noise: its -3 dB and -90° frequencies."""
    from scipy.signal import lsim

    chirp = tracking.Chirp(1.0, 20.0, 20.0)
    fine = np.arange(0.0, 20.0, 0.001)
    w = 2.0 * math.pi * 8.0
    _, out, _ = lsim(([w * w], [1.0, 1.4 * w, w * w]), chirp(fine), fine)
    noise = np.random.default_rng(0).normal(0.0, 2e-5, len(fine))
    trace = tracking.Trace(fine[::20], chirp(fine)[::20], (out + noise)[::20])
    gain_hz, phase_hz = tracking.bandwidths(*tracking.response(trace, chirp))
    damped = 1.0 - 2.0 * 0.49
    assert gain_hz == pytest.approx(8.0 * math.sqrt(damped + math.sqrt(damped**2 + 1.0)), rel=0.04)
    assert phase_hz == pytest.approx(8.0, rel=0.04)


def test_computed_torque_beats_the_drives_own_cascade(tmp_path):
    step, chirp, gain = tracking.measure(Options(quick=True, plots=tmp_path))
    assert gain.value("drive", "step RMS") > 3.0
    assert gain.value("drive", "chirp RMS") > 3.0
    assert step.value("computed torque", "overshoot, %") < 5.0
    assert step.value("wanted", "overshoot, %") < 2.0
    assert chirp.value("drive, pre-control", "RMS error, mm") < chirp.value(
        "drive", "RMS error, mm"
    )
    assert (tmp_path / "tracking.html").stat().st_size > 10**5


def test_every_slot_carries_a_pair():
    (table,) = operation.measure(QUICK)
    for rig in operation.RIGS:
        assert table.value(rig, "slots with a pair, %") == 100.0
        assert table.value(rig, "overruns") == table.value(rig, "warnings and faults") == 0


def test_the_bare_loop_counts_every_period():
    lateness = loop_lateness.measure_bare(0.002, 0.4)
    assert lateness.late_us.size + lateness.overruns == 200
    assert lateness.late_us.min() > 0.0


@pytest.mark.benchmark_ratio
def test_the_plant_is_faster_than_mujoco_with_the_same_mechanism():
    (table,) = sim_vs_mujoco.measure(QUICK)
    assert table.value("motorcycle", "ratio") > 2.0
    assert table.value("stewart", "ratio") > 2.0


@pytest.mark.benchmark_ratio
def test_leg_forces_cost_less_than_through_pinocchio():
    _, ratios = rigs_vs_pinocchio.measure(QUICK)
    assert ratios.value("leg forces", "ratio") > 3.0


@pytest.mark.benchmark_ratio
def test_all_figures_come_by_name():
    asked = subprocess.run(
        [sys.executable, "-m", "benchmarks", "--quick", "--json", "step_cost"],
        capture_output=True,
        text=True,
        timeout=170,
        check=False,
        cwd=Path(__file__).parents[2],
    )
    assert asked.returncode == 0, asked.stderr
    rows = json.loads(asked.stdout)["step_cost"]["tables"][0]["rows"]
    bare = rows["motorcycle, bare inverse dynamics, one call"]["p50"]
    assert bare < rows["motorcycle, computed_torque"]["p50"] < 400.0 * bare
    refused = subprocess.run(
        [sys.executable, "-m", "benchmarks", "nothing"],
        capture_output=True,
        text=True,
        check=False,
        cwd=Path(__file__).parents[2],
    )
    assert refused.returncode == 2
    assert "there are tracking" in refused.stderr
