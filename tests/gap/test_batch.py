"""Many diagnoses: found, shared out, interrupted, resumed."""

import json
import shutil

import pytest

from hil.errors import ConfigError, RunError
from hil.gap.batch import do_job, find_jobs, run_jobs, summary
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
    run_jobs(jobs, done.__setitem__)
    assert done["good"] == "no_gap"
    assert done["bad"].startswith("failed: ")
    assert json.loads(jobs[0].answer.read_text())["verdict"] == "no_gap"
    again = {}
    run_jobs(jobs, again.__setitem__)
    assert list(again) == ["bad"]
    good_row, bad_row = summary(jobs)
    assert (good_row["verdict"], bad_row["verdict"]) == ("no_gap", "failed")
    shutil.rmtree(bad)
    run_folder(bad, healthy)
    assert do_job(jobs[1]) == "no_gap"
    assert not jobs[1].failure.exists()


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
