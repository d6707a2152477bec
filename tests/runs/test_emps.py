"""The EMPS benchmark through import, least squares and twin, against what its authors published.

Published figures: "Data Set and Reference Models of EMPS" (Janot, Gautier, Brunot, 2019), sections 3.4, 3.5.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import scipy.signal

from hil.configfile import load_rig
from hil.runs import Run, load_run
from hil.runs.importing import find_map, import_run
from hil.sim.twin import Twin
from tests.shared_data import shared

pytestmark = pytest.mark.shared

DT_S = 1e-3
BORDER = 49
"""Samples that the authors leave out at the start."""
M, FV, FC, OFFSET = 95.1089, 203.5034, 20.3935, -3.1648
KP, KV, GTAU = 160.18, 243.45, 35.15065188


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Run]:
    folder = tmp_path_factory.mktemp("emps")
    made = {}
    for name, log in (("emps", "DATA_EMPS.mat"), ("emps_pulses", "DATA_EMPS_PULSES.mat")):
        report = import_run(shared(f"data/emps/{log}"), find_map(name), folder / name)
        assert not [f for f in report.findings if f.verdict in ("warning", "fault")]
        made[name] = load_run(Path(report.folder))
    return made


def columns(run: Run) -> tuple[np.ndarray, ...]:
    names = ("t", "axis.setpoint", "axis.position", "axis.force")
    return tuple(run.table[n].to_numpy() for n in names)


def filtered(q: np.ndarray) -> np.ndarray:
    """Fourth-order Butterworth at 100 Hz, forward and back."""
    return scipy.signal.filtfilt(*scipy.signal.butter(4, 100.0 / 500.0), q, padlen=12)


def rate(x: np.ndarray) -> np.ndarray:
    return np.gradient(x, DT_S)


def decimated(x: np.ndarray) -> np.ndarray:
    """MATLAB's decimate(x, 10): Chebyshev I of order 8, forward and back, one sample in ten from the end."""
    low = scipy.signal.cheby1(8, 0.05, 0.08, output="sos")
    smooth = scipy.signal.sosfiltfilt(low, x, padlen=24)
    first = 10 - (10 * -(-len(x) // 10) - len(x)) - 1
    return smooth[first::10]


def regression(run: Run) -> tuple[np.ndarray, np.ndarray]:
    _, _, q, force = columns(run)
    dq = rate(filtered(q))
    terms = (rate(dq), dq, np.sign(dq), np.ones_like(dq))
    return np.column_stack([decimated(x[BORDER:]) for x in terms]), decimated(force[BORDER:])


def error(y: np.ndarray, model: np.ndarray) -> float:
    """Relative error, %: eq. (11)."""
    return float(100.0 * np.linalg.norm(y - model) / np.linalg.norm(y))


def test_least_squares_with_the_authors_filter_gives_their_parameters(runs):
    a, y = regression(runs["emps"])
    parameters = np.linalg.lstsq(a, y, rcond=None)[0]
    np.testing.assert_allclose(parameters, [M, FV, FC, OFFSET], rtol=1e-4)
    assert error(y, a @ parameters) == pytest.approx(4.0834, abs=5e-4)
    assert np.linalg.cond(a) == pytest.approx(25.9883, abs=1e-3)
    across, force = regression(runs["emps_pulses"])
    assert error(force, across @ parameters) == pytest.approx(5.9824, abs=5e-4)


def test_the_rig_file_holds_the_published_numbers():
    rig = load_rig("emps")
    actuator = rig.actuators[0]
    assert rig.mass.m + actuator.reflected_mass == pytest.approx(M)
    assert (actuator.viscous, actuator.coulomb) == (FV, FC)
    assert actuator.position_gain == KP
    assert actuator.speed_gain == pytest.approx(KV * GTAU)
    assert actuator.force_max == pytest.approx(10.0 * GTAU)
    assert {"offset": OFFSET} in [dict(e.parameters) for e in rig.effects]


@pytest.mark.parametrize(("name", "rms_volts"), [("emps", 0.005), ("emps_pulses", 0.05)])
def test_setpoint_and_force_satisfy_the_control_law_pulses_and_all(runs, name, rms_volts):
    _, setpoint, q, force = columns(runs[name])
    means = 0.5 * (q[1:] + q[:-1])
    speed = np.diff(means) / DT_S
    volts = KP * KV * (setpoint - q)[2:] - KV * speed
    assert np.std(volts - force[2:] / GTAU) < rms_volts


@pytest.mark.parametrize(
    ("name", "published"),
    [
        (
            "emps",
            {"position": 0.013752, "velocity": 0.22911, "acceleration": 8.6036, "force": 5.848},
        ),
        (
            "emps_pulses",
            {"position": 0.0080248, "velocity": 0.47888, "acceleration": 19.8152, "force": 8.9409},
        ),
    ],
)
def test_the_twin_replays_the_record_at_least_as_well_as_the_authors_simulation(
    runs, name, published
):
    run = runs[name]
    t, setpoint, q, force = columns(run)
    assert run.rig is not None
    answer = Twin(run.rig, substeps=4).replay(
        {"axis": (t, setpoint)}, {"axis.position": t, "axis.force": t}, start=[q[0]]
    )
    measured, model = filtered(q), answer["axis.position"]
    ours = {
        "position": error(measured[BORDER:], model[BORDER:]),
        "velocity": error(rate(measured)[BORDER:], rate(model)[BORDER:]),
        "acceleration": error(rate(rate(measured))[BORDER:], rate(rate(model))[BORDER:]),
        "force": error(force[BORDER:], answer["axis.force"][BORDER:]),
    }
    print(name, {k: round(v, 5) for k, v in ours.items()})
    for quantity, theirs in published.items():
        assert ours[quantity] <= theirs, quantity
        assert ours[quantity] > 0.1 * theirs, f"{quantity}: better than the data can be"


def test_other_public_records_come_in_by_their_maps(tmp_path):
    for name, log, samples in (
        ("bicycle_delft", "sbw_bicycle/logs/eigen_normal_sil6.5n2_14.4kph.log.gz", 9163),
        ("xsens_acc", "imu_xsens_calib/xsens_acc.txt.gz", 51175),
        ("xsens_gyro", "imu_xsens_calib/xsens_gyro.txt.gz", 51175),
    ):
        report = import_run(shared(f"data/{log}"), find_map(name), tmp_path / name)
        run = load_run(Path(report.folder))
        assert {s.samples for s in report.signals} == {samples}
        assert not [f for f in report.findings if f.check in ("unit", "gaps", "nan_block")]
        assert run.duration_s == pytest.approx(samples / 100.0, rel=2e-4)
    accel = load_run(tmp_path / "xsens_acc").table[[f"imu.accel_{a}" for a in "xyz"]].to_numpy()
    # The first 50 s the sensor rests; uncalibrated it reads gravity to within ten percent.
    assert np.linalg.norm(accel[:4500].mean(axis=0)) == pytest.approx(9.81744, rel=0.1)
