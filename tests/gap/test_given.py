"""What Python callers may give `locate` and `diagnose`, and what they are told of anything else."""

import numpy as np
import pandas as pd
import pytest

import hil.gap.bicycle.either as either
from hil.configfile import find_rig_file, load_rig
from hil.errors import ConfigError, RunError
from hil.gap import diagnose, locate
from hil.gap.record.runs import as_runs

AXIS = load_rig("axis")


def frame(samples=400, step_s=0.01, scale=1.0):
    t = step_s * np.arange(samples)
    told = 0.1 * scale * np.sin(np.arange(samples) / 50.0)
    return pd.DataFrame({"t": t, "axis.setpoint": told, "axis.position": told})


@pytest.fixture
def folder(tmp_path):
    path = tmp_path / "first"
    path.mkdir()
    (path / "run.toml").write_text('format = "hil-run/1"\nrig = "axis"\n')
    frame().to_csv(path / "signals.csv", index=False)
    return path


@pytest.fixture
def asked(monkeypatch):
    """What reaches the steps behind the entry points, which cost nothing here."""
    told = []

    def reached(runs, rig, **how):
        told.append((runs, rig, how))

    monkeypatch.setattr(either, "locate", reached)
    monkeypatch.setattr(either, "diagnose", reached)
    return told


def test_runs_and_rigs_may_be_paths_and_names(folder, asked):
    for given in (str(folder), folder, [folder, frame(scale=0.9)]):
        locate(given, "axis")
        diagnose(given, str(find_rig_file("axis")), references=None)
    for runs, rig, _ in asked:
        assert runs[0].path == folder
        assert rig == AXIS
    diagnose(frame(scale=0.9), AXIS, references=str(folder))
    (healthy,) = asked[-1][2]["references"]
    assert healthy.path == folder


@pytest.mark.parametrize(
    ("call", "error", "said"),
    [
        (lambda: locate([], AXIS), RunError, "runs: holds no run"),
        (lambda: locate(3, AXIS), TypeError, "runs: is a int; give a Run"),
        (lambda: locate([frame(), None], AXIS), TypeError, "run 2: is a NoneType; give a Run"),
        (lambda: locate([frame(), frame()], AXIS), RunError, "frame 2: is given twice"),
        (lambda: diagnose(frame(), AXIS, references=frame()), RunError, "is its own reference"),
        (lambda: locate("nowhere", AXIS), RunError, "nowhere: no such run"),
        (lambda: locate(frame(), None), TypeError, "rig is a NoneType: give a rig"),
        (lambda: locate(frame(), "axes"), ConfigError, "axes: no such rig file"),
        (lambda: locate(frame(), AXIS, seed=-1), ValueError, "seed: -1"),
        (lambda: diagnose(frame(), AXIS, without="backlash"), TypeError, r"\['backlash'\]"),
        (lambda: diagnose(frame(), AXIS, without=["backlsh"]), ConfigError, "no effect backlsh"),
    ],
)
def test_what_cannot_be_used_is_named_with_what_is_expected(call, error, said, asked):
    with pytest.raises(error, match=said):
        call()
    assert not asked


def test_millimetres_are_told_by_the_value_that_is_furthest_off():
    with pytest.raises(
        RunError, match=r"axis.setpoint.*up to 100, lie far outside .* m of .*these millimetres"
    ):
        as_runs(frame(scale=1000.0), AXIS)


@pytest.mark.parametrize("per_second", [1e3, 1e6, 1e9])
def test_a_t_that_is_not_in_seconds_is_asked_about(per_second):
    with pytest.raises(RunError, match=r"column t: 400 samples.* is it in ms, us or ns here"):
        as_runs(frame(step_s=0.01 * per_second), AXIS)
    assert as_runs(frame(samples=100, step_s=1.0), AXIS)


def test_dates_and_spans_of_time_are_refused_by_name():
    numbers = frame()
    dates = pd.to_datetime(numbers["t"], unit="s")
    for kind in (dates, dates.dt.tz_localize("UTC")):
        with pytest.raises(RunError, match=r"column t: holds datetime64.*convert it to seconds"):
            as_runs(numbers.assign(t=kind), AXIS)
    with pytest.raises(RunError, match=r"column t: holds timedelta64.*convert it to seconds"):
        as_runs(numbers.assign(t=dates - dates[0]), AXIS)
