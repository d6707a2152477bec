"""Many diagnoses: found, shared out, interrupted, resumed."""

import json
import shutil
from dataclasses import dataclass

import pytest
from typer.testing import CliRunner

from hil.cli.app import app
from hil.configfile import find_rig_file
from hil.errors import ConfigError, RunError
from hil.gap.batch import do_job, find_jobs, open_jobs, run_jobs, summary
from tests.gap.twin_runs import record

META = 'format = "hil-run/1"\nrig = "axis"\nmode = "position"\n'


@pytest.fixture(scope="module")
def healthy():
    return record(duration_s=8.0)


def run_folder(path, table, extra=""):
    path.mkdir(parents=True)
    (path / "run.toml").write_text(META + extra)
    table.to_csv(path / "signals.csv", index=False)
    return path


def broken(path):
    """A run that no verdict can stand on: quick to be refused."""
    path.mkdir(parents=True)
    (path / "run.toml").write_text(META)
    (path / "signals.csv").write_text("t,axis.setpoint\n0,0\n1,0\n")
    return path


def test_a_run_is_a_job_and_a_folder_of_runs_is_one_with_its_references(tmp_path, healthy):
    alone = run_folder(tmp_path / "alone", healthy[:20])
    for name, extra in (("run1", ""), ("run2", ""), ("run0", 'role = "reference"\n')):
        run_folder(tmp_path / "group" / name, healthy[:20], extra)
    one, group = find_jobs([alone, tmp_path / "group"], "axis", tmp_path / "out")
    assert (one.name, len(one.runs), one.references) == ("alone", 1, ())
    assert [p.rsplit("/", 1)[1] for p in group.runs] == ["run1", "run2"]
    assert [p.rsplit("/", 1)[1] for p in group.references] == ["run0"]
    with pytest.raises(RunError, match="same name"):
        find_jobs([alone, alone], "axis", tmp_path / "out")
    (tmp_path / "empty").mkdir()
    with pytest.raises(RunError, match="no run to diagnose"):
        find_jobs([tmp_path / "empty"], "axis", tmp_path / "out")


def test_what_is_finished_is_not_done_again_and_what_failed_is(tmp_path, healthy):
    good, bad = run_folder(tmp_path / "good", healthy), broken(tmp_path / "bad")
    jobs = find_jobs([good, bad], "axis", tmp_path / "out")
    done = {}
    assert run_jobs(list(open_jobs(jobs)), done.__setitem__) == 1
    assert done["good"] == "no_gap"
    assert done["bad"].startswith("failed: ")
    assert json.loads(jobs[0].answer.read_text())["verdict"] == "no_gap"
    again = {}
    run_jobs(list(open_jobs(jobs)), again.__setitem__)
    assert list(again) == ["bad"]
    good_row, bad_row = summary(jobs)
    assert (good_row["verdict"], bad_row["verdict"]) == ("no_gap", "failed")
    shutil.rmtree(bad)
    run_folder(bad, healthy)
    assert do_job(jobs[1]) == "no_gap"
    assert not jobs[1].failure.exists()


@dataclass(frozen=True)
class Said:
    """A diagnosis that took no time."""

    verdict: str = "no_gap"

    def tables(self):
        return {"verdict": self.verdict, "effects": [], "gap": {}}


@pytest.fixture
def quick(monkeypatch):
    """Jobs whose runs are read and not judged."""
    monkeypatch.setattr("hil.gap.batch.diagnose_any", lambda *runs, **how: Said())


def test_an_answer_counts_only_for_what_it_was_made_of(tmp_path, healthy, quick):
    rig = tmp_path / "axis.toml"
    rig.write_text(find_rig_file("axis").read_text())
    first = run_folder(tmp_path / "first", healthy[:20])
    other = run_folder(tmp_path / "elsewhere" / "first", healthy[:30])
    reference = run_folder(tmp_path / "zero", healthy[:20])

    def jobs(place=first, **how):
        return find_jobs([place], str(rig), tmp_path / "out", **how)

    def why(**how):
        return list(open_jobs(jobs(**how)).values())

    assert why() == [""]
    run_jobs(jobs(), lambda name, text: None)
    assert why() == []
    assert why(seed=1) == ["the seed changed since"]
    assert why(without=["backlash"]) == ["the effects changed since"]
    assert why(references=[reference]) == ["the references changed since"]
    assert why(place=other) == ["the runs changed since"]
    assert summary(jobs(place=other))[0]["verdict"] == "open"
    rig.write_text(rig.read_text().replace("m = 95.0", "m = 96.0"))
    assert why() == ["the rig file changed since"]
    run_jobs(jobs(), lambda name, text: None)
    healthy[:25].to_csv(first / "signals.csv", index=False)
    assert why() == ["the runs changed since"]
    said = json.loads(jobs()[0].answer.read_text())
    del said["made_of"]
    jobs()[0].answer.write_text(json.dumps(said))
    assert why() == ["the answer there does not say what it was made of"]


def test_the_command_says_what_it_does_anew_and_ends_with_1_where_a_job_failed(
    tmp_path, healthy, quick
):
    good, bad = run_folder(tmp_path / "good", healthy[:20]), tmp_path / "bad"
    run_folder(bad, healthy[:20])
    (bad / "signals.csv").write_text("t,axis.setpoint\n0,0\n0,1\n")
    told = ["gap", "batch", str(good), str(bad), "--rig", "axis", "--out", str(tmp_path / "out"),
            "--jobs", "1"]  # fmt: skip
    first = CliRunner().invoke(app, told)
    assert first.exit_code == 1
    assert "1 of 2 failed" in first.stderr
    assert "stands still" in first.stdout
    shutil.rmtree(bad)
    again = CliRunner().invoke(app, [*told[:3], *told[4:], "--seed", "4"])
    assert again.exit_code == 0
    assert "good: done anew: the seed changed since" in again.stderr


def test_a_folder_for_the_answers_that_cannot_be_is_named(tmp_path, healthy):
    run, file = run_folder(tmp_path / "run", healthy[:20]), tmp_path / "out"
    file.write_text("")
    for place in (file, file / "in"):
        with pytest.raises(ConfigError, match="no folder for answers"):
            run_jobs(find_jobs([run], "axis", place), lambda name, text: None)


def test_a_cluster_with_two_workers_shares_the_jobs(tmp_path):
    distributed = pytest.importorskip("distributed")
    jobs = find_jobs([broken(tmp_path / n) for n in "abc"], "axis", tmp_path / "out")
    done = {}
    with distributed.LocalCluster(
        n_workers=2,
        threads_per_worker=1,
        processes=False,
        protocol="tcp",
        host="127.0.0.1",
        dashboard_address=None,
    ) as cluster:
        run_jobs(jobs, done.__setitem__, scheduler=cluster.scheduler_address)
    assert sorted(done) == ["a", "b", "c"]
    assert all(j.failure.is_file() for j in jobs)


def test_a_scheduler_that_is_not_there_is_named(tmp_path, monkeypatch):
    pytest.importorskip("distributed")
    monkeypatch.setattr("hil.gap.batch.CONNECT_S", 0.5)
    jobs = find_jobs([broken(tmp_path / "a")], "axis", tmp_path / "out")
    with pytest.raises(ConfigError, match="no dask scheduler answers there"):
        run_jobs(jobs, lambda name, text: None, scheduler="tcp://127.0.0.1:9")


@pytest.mark.parametrize("address", ["127.0.0.1", "http://127.0.0.1:9"])
def test_an_address_that_is_none_of_a_scheduler_is_named(tmp_path, address):
    pytest.importorskip("distributed")
    jobs = find_jobs([broken(tmp_path / "a")], "axis", tmp_path / "out")
    with pytest.raises(ConfigError, match=f"{address}: is no tcp://HOST:PORT"):
        run_jobs(jobs, lambda name, text: None, scheduler=address)


@pytest.mark.parametrize("name", ["gone", "gone.mcap"])
def test_a_place_that_is_not_there_is_named(tmp_path, name):
    with pytest.raises(RunError, match=f"{name}: no such run or folder"):
        find_jobs([tmp_path / name], "axis", tmp_path / "out")
