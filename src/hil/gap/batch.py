"""Many diagnoses: local processes or a dask.distributed cluster, finished ones never done again.

A job is the runs that are diagnosed together. Its answer is a file `<name>.json`, written whole or not at
all, which is what makes a batch resumable: interrupt it and start it again. A job that fails says so in
`<name>.error.txt` and is tried again by the next start.
"""

from __future__ import annotations

import json
import multiprocessing
import os
from collections.abc import Callable, Collection, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hil.configfile import load_any_rig
from hil.errors import ConfigError, HilError, RunError
from hil.gap.bicycle import diagnose_any
from hil.runs import load_run
from hil.runs.folder import RUN_TOML, read_meta

OnDone = Callable[[str, str], None]

CONNECT_S = 10.0
"""How long a scheduler is waited for."""


@dataclass(frozen=True, slots=True)
class Job:
    """Runs that are diagnosed together."""

    name: str
    rig: str
    """Path of a rig file, or the name of one that comes with hil."""
    runs: tuple[str, ...]
    references: tuple[str, ...]
    without: tuple[str, ...]
    seed: int
    out: str
    """Folder of the answers."""

    @property
    def answer(self) -> Path:
        """Where the diagnosis is kept."""
        return Path(self.out) / f"{self.name}.json"

    @property
    def failure(self) -> Path:
        """Where it is kept why there is none."""
        return Path(self.out) / f"{self.name}.error.txt"


def find_jobs(
    places: Sequence[Path],
    rig: str,
    out: Path,
    *,
    references: Sequence[Path] = (),
    without: Collection[str] = (),
    seed: int = 0,
) -> list[Job]:
    """A job for each run in `places`, and one for each folder of runs, all of whose runs go together.

    Runs with the role "reference" in a folder calibrate its job; `references` calibrate every job. A folder
    with a rig.toml of its own is judged by that. RunError where a place holds no run or two share a name.
    """
    jobs = []
    for place in places:
        own = place / "rig.toml"
        if place.suffix == ".mcap" or (place / RUN_TOML).is_file():
            told, healthy, file = [place], [], rig
        else:
            inner = sorted(p.parent for p in place.glob(f"*/{RUN_TOML}"))
            roles = [read_meta(p).role for p in inner]
            told = [p for p, role in zip(inner, roles, strict=True) if role != "reference"]
            healthy = [p for p, role in zip(inner, roles, strict=True) if role == "reference"]
            file = str(own) if own.is_file() else rig
        if not told:
            raise RunError(f"{place}: holds no run to diagnose")
        name = place.stem if place.suffix == ".mcap" else place.resolve().name
        jobs.append(
            Job(
                name, file, _paths(told), _paths([*references, *healthy]), tuple(without), seed,
                str(out.resolve()),
            )
        )  # fmt: skip
    names = [j.name for j in jobs]
    twice = sorted({n for n in names if names.count(n) > 1})
    if twice:
        raise RunError(f"two places to diagnose have the same name: {', '.join(twice)}")
    return jobs


def run_jobs(
    jobs: Sequence[Job], on_done: OnDone, *, workers: int = 1, scheduler: str | None = None
) -> None:
    """Do the jobs that have no answer yet; `on_done` is told name and verdict (or "failed: why") of each.

    `scheduler`: address of a dask.distributed scheduler; its workers must see the same files. ConfigError
    where it cannot be reached or distributed is not installed.
    """
    todo = [j for j in jobs if not j.answer.is_file()]
    if todo:
        Path(todo[0].out).mkdir(parents=True, exist_ok=True)
    if scheduler is not None:
        done = _on_cluster(todo, scheduler)
    elif workers > 1 and len(todo) > 1:
        done = _in_processes(todo, workers)
    else:
        done = ((j.name, do_job(j)) for j in todo)
    for name, text in done:
        on_done(name, text)


def do_job(job: Job) -> str:
    """Diagnose one job and keep the answer; returns the verdict, or "failed: why"."""
    try:
        rig = load_any_rig(job.rig)
        runs = [load_run(Path(p), rig) for p in job.runs]
        healthy = [load_run(Path(p), rig) for p in job.references]
        found = diagnose_any(runs, rig, references=healthy, without=job.without, seed=job.seed)
    except (HilError, ArithmeticError, ValueError, LookupError) as error:
        _keep(job.failure, f"{type(error).__name__}: {error}\n".encode())
        return f"failed: {error}"
    _keep(job.answer, found.to_json() + b"\n")
    job.failure.unlink(missing_ok=True)
    return found.verdict


def summary(jobs: Sequence[Job]) -> list[dict[str, Any]]:
    """A row a job, from its file: name, verdict, effects, probability, shrink, or why it failed."""
    rows = []
    for job in jobs:
        row: dict[str, Any] = {"name": job.name, "verdict": "open", "effects": "", "probability": None,
                               "shrink": None}  # fmt: skip
        if job.answer.is_file():
            said = json.loads(job.answer.read_text(encoding="utf-8"))
            row["verdict"] = said["verdict"]
            row["effects"] = " + ".join(f"{e['location']}.{e['effect']}" for e in said["effects"])
            row["probability"] = min((e["probability"] for e in said["effects"]), default=None)
            row["shrink"] = said["gap"].get("shrink")
        elif job.failure.is_file():
            row["verdict"] = "failed"
            row["effects"] = job.failure.read_text(encoding="utf-8").strip()
        rows.append(row)
    return rows


def _paths(places: Sequence[Path]) -> tuple[str, ...]:
    return tuple(str(p.resolve()) for p in places)


def _keep(path: Path, data: bytes) -> None:
    """Write whole or not at all, so that an interrupted batch leaves no half answer."""
    fresh = path.with_name(f".{path.name}.{os.getpid()}")
    fresh.write_bytes(data)
    fresh.replace(path)


def _in_processes(jobs: Sequence[Job], workers: int) -> Iterator[tuple[str, str]]:
    pool = ProcessPoolExecutor(workers, mp_context=multiprocessing.get_context("spawn"))
    under_way: dict[Future[str], Job] = {pool.submit(do_job, j): j for j in jobs}
    try:
        for future in as_completed(under_way):
            job = under_way[future]
            try:
                yield job.name, future.result()
            except BrokenProcessPool:
                yield job.name, "failed: its process died; start the batch again"
    finally:
        pool.shutdown(wait=False, cancel_futures=True)


def _on_cluster(jobs: Sequence[Job], scheduler: str) -> Iterator[tuple[str, str]]:
    try:
        from distributed import Client
        from distributed import as_completed as completed
    except ImportError as error:
        raise ConfigError("--scheduler needs dask.distributed: pip install 'hil[batch]'") from error
    try:
        client = Client(scheduler, timeout=CONNECT_S)  # type: ignore[no-untyped-call]
    except OSError as error:
        raise ConfigError(f"{scheduler}: no dask scheduler answers there: {error}") from error
    with client:
        under_way = {client.submit(do_job, j, pure=False): j for j in jobs}
        for future in completed(list(under_way)):  # type: ignore[no-untyped-call]
            fault = future.exception()
            yield under_way[future].name, future.result() if fault is None else f"failed: {fault}"
