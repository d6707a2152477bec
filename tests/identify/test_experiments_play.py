"""A played experiment leaves a run that says what was played and when each period began."""

import shutil
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from hil.cli.options import profiles_of, rig_with
from hil.config import Effect
from hil.configfile import load_rig
from hil.errors import CommandRefused, RunError
from hil.identify.experiments import (
    Custom,
    Heave,
    Multisine,
    design,
    experiment_of,
    periods,
    write_experiment,
)
from hil.identify.experiments.custom import read_custom
from hil.identify.experiments.play import play_on_rig, play_simulated
from hil.messages import CommandReply
from hil.runs import load_run, read_cue_file
from hil.runs.folder import EXPERIMENT_CSV, EXPERIMENT_TOML

PLAN = Multisine(
    period_s=2.0, f_min=0.5, f_max=2.5, periods=2, settle_periods=0, realisations=1, fade_s=1.0,
    lines="full",
)  # fmt: skip


@pytest.fixture(scope="module")
def played(tmp_path_factory):
    rig, text = rig_with("axis")
    made = design(PLAN, rig)
    runs = tmp_path_factory.mktemp("runs")
    backlash = Effect(effect="backlash", location="axis", parameters={"gap": 0.0004})
    folder = play_simulated(made, rig, text, profiles_of(rig), runs, seed=3, effects=[backlash])
    return made, folder


def test_the_description_reads_back_as_it_was_written(played):
    made, folder = played
    found = experiment_of(folder)
    assert found.model_copy(update={"played": None}) == made.description
    assert found.plan == PLAN
    assert (found.played.on, found.played.seed) == ("simulated", 3)
    assert found.played.effects == ("axis.backlash.gap=0.0004",)


def test_a_description_makes_the_same_motion_again(played):
    made, folder = played
    again = design(experiment_of(str(folder)).plan, load_rig("axis"))
    assert np.array_equal(again.trajectory.poses, made.trajectory.poses)
    kept = read_cue_file(folder / EXPERIMENT_CSV).trajectory
    assert kept.poses == pytest.approx(made.trajectory.poses, abs=1e-9)


def test_setpoints_are_the_design_at_the_instant_that_the_description_says(played):
    """Setpoints go out a cycle ahead: the drive is to be there when the next one comes."""
    made, folder = played
    run = load_run(folder)
    t = run.table["t"].to_numpy() - experiment_of(folder).played.start_s
    sent = run.table["axis.setpoint"].to_numpy()
    inside = ~np.isnan(sent) & (t > 0.0) & (t < made.trajectory.duration_s - 0.02)
    designed = CubicSpline(made.trajectory.t_s, made.trajectory.poses[:, 0])(t[inside] + 0.01)
    speed = np.max(np.abs(made.trajectory.derivatives()[0]))
    # The bus's send jitter is a few tenths of a millisecond, and it is time that is compared.
    assert np.max(np.abs(sent[inside] - designed)) < 0.002 * speed
    assert np.mean(sent[inside] - designed) == pytest.approx(0.0, abs=2e-4 * speed)


def test_periods_cut_by_the_description_are_alike(played):
    _, folder = played
    run = load_run(folder)
    found = list(periods(experiment_of(folder)))
    assert [p.realisation for p in found] == [0, 0]
    assert [round(p.end_s - p.start_s, 6) for p in found] == [2.0, 2.0]
    position = run.table[["t", "axis.position"]].dropna()
    grid = np.linspace(0.1, 1.9, 90)
    first, second = (
        np.interp(p.start_s + grid, position["t"], position["axis.position"]) for p in found
    )
    assert np.max(np.abs(first - second)) < 0.02 * np.ptp(first)


def test_the_rig_file_kept_with_the_run_does_not_know_the_effect(played):
    _, folder = played
    run = load_run(folder)
    assert run.rig.effects == ()
    assert "multisine" in run.meta.note


def test_the_effect_was_at_work(played, tmp_path):
    """Backlash: the load's encoder side differs from what a healthy rig answers."""
    made, folder = played
    rig, text = rig_with("axis")
    healthy = play_simulated(made, rig, text, profiles_of(rig), tmp_path, seed=3)
    hurt, well = (load_run(f).table["axis.force"].dropna().to_numpy() for f in (folder, healthy))
    assert np.std(hurt) != pytest.approx(np.std(well), rel=1e-3)


def test_an_ordinary_run_is_no_experiment(tmp_path):
    assert experiment_of(tmp_path) is None


def test_a_damaged_description_is_named(tmp_path):
    rig = load_rig("axis")
    made = design(Heave(cycles=1, frequency=1.0, fade_s=0.5), rig)
    write_experiment(tmp_path, made.description, made.trajectory)
    path = tmp_path / EXPERIMENT_TOML
    path.write_text(path.read_text().replace("cycles = 1", "cycles = 0"))
    with pytest.raises(RunError, match=r"experiment\.toml: plan\.\w*\.?cycles: .*1 \(got 0\)"):
        experiment_of(tmp_path)


def test_a_rig_that_gives_up_on_the_way_is_told(tmp_path):
    """A force limit that cannot move the load lets the following error trip."""
    rig, text = rig_with("axis")
    made = design(Heave(cycles=2, frequency=0.5, fade_s=1.0), rig)
    weak = Effect(effect="force_saturation", location="axis", parameters={"limit": 15.0})
    with pytest.raises(CommandRefused, match="axis did not play the motion to its end"):
        play_simulated(made, rig, text, profiles_of(rig), tmp_path, effects=[weak])
    (folder,) = tmp_path.iterdir()
    assert experiment_of(folder) is None  # half a motion must not be taken for the whole


class Daemon:
    """A client of a daemon that records a copy of `run`, while another rig begins one in the same folder."""

    rig = "axis"

    def __init__(self, run, runs):
        self._run, self._runs = run, runs

    def states(self):
        return (SimpleNamespace(state=state, fault="") for state in ("ready", "parked"))

    def command(self, name, on):
        assert name == "record"
        if on and not self._runs.exists():
            for stamp in ("1_another", "2_axis", "3_another"):
                shutil.copytree(self._run, self._runs / stamp)
                (self._runs / stamp / EXPERIMENT_TOML).unlink()
        return CommandReply(True, "", "/where/the/daemon/sees/it/2_axis" if on else "")


def _no_motion(*_):
    pytest.fail("the rig moves for a recording that cannot be found")


def test_the_experiment_is_kept_with_the_recording_of_its_own_rig(played, tmp_path, monkeypatch):
    made, run = played
    monkeypatch.setattr("hil.identify.experiments.play.stream", lambda *_: None)
    runs = tmp_path / "runs"
    daemon = Daemon(run, runs)
    assert play_on_rig(made, load_rig("axis"), daemon, runs) == runs / "2_axis"
    assert [f.name for f in runs.iterdir() if experiment_of(f) is not None] == ["2_axis"]
    monkeypatch.setattr("hil.identify.experiments.play.stream", _no_motion)
    with pytest.raises(RunError, match=r"else.2_axis: is not here; .* with --runs"):
        play_on_rig(made, load_rig("axis"), daemon, tmp_path / "else")


def test_a_custom_file_must_stay_the_same(tmp_path):
    path = tmp_path / "motion.csv"
    path.write_text("t,position\n0,0\n1,0.01\n2,0\n")
    plan, motion = read_custom(Custom(file=str(path)))
    assert len(plan.sha256) == 64
    assert motion.coordinates == ("position",)
    path.write_text("t,position\n0,0\n1,0.02\n2,0\n")
    with pytest.raises(RunError, match="is not the file that this experiment was designed with"):
        read_custom(plan)
