"""Many diagnoses: local processes or a dask.distributed cluster, finished ones never done again.

A job is the runs that are diagnosed together. Its answer is a file `<name>.json`, written whole or not at
all, which is what makes a batch resumable: interrupt it and start it again. The answer keeps what it was made
of (`made_of`), and counts only for the same rig file, runs, references, effects and seed. A job that fails
says so in `<name>.error.txt` and is tried again by the next start.
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Collection, Generator, Sequence
from concurrent.futures import Future, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import closing, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import msgspec

from hil.configfile import load_any_rig
from hil.effectlines import checked
from hil.errors import ConfigError, HilError, RunError
from hil.files import write_whole
from hil.gap.bicycle import diagnose_any
from hil.gap.record.inputs import differing, inputs_of
from hil.runs import load_run
from hil.runs.folder import RUN_TOML, read_meta
from hil.workers import worker_pool

OnDone = Callable[[str, str], None]

FAILED: Final = "failed: "
CONNECT_S = 10.0
"""How long a scheduler is waited for."""
MADE_OF: Final = "made_of"
"""Key of an answer under which stands what it was made of."""


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

    def inputs(self) -> dict[str, Any]:
        """What its answer is made of; HilError where a file cannot be read."""
        return inputs_of(self.rig, self.runs, self.references, self.without, self.seed)


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
        if not place.exists():
            raise RunError(f"{place}: no such run or folder")
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


def open_jobs(jobs: Sequence[Job]) -> dict[Job, str]:
    """The jobs that have no answer, or one of something else; with why that no longer counts, or ""."""
    why = {job: _why_open(job) for job in jobs}
    return {job: text for job, text in why.items() if text is not None}


def _why_open(job: Job) -> str | None:
    """None where the answer that is kept is made of what the job is made of now."""
    said = _kept(job)
    if said is None:
        return ""
    if MADE_OF not in said:
        return "the answer there does not say what it was made of"
    with suppress(HilError):  # what cannot be read fails as the job, with its reason
        changed = differing(said[MADE_OF], job.inputs())
        return f"{', '.join(changed)} changed since" if changed else None
    return ""


def _kept(job: Job) -> dict[str, Any] | None:
    """The answer in the job's file; None where there is none that can be read."""
    try:
        said = json.loads(job.answer.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    return said if isinstance(said, dict) else None


def run_jobs(
    jobs: Sequence[Job], on_done: OnDone, *, workers: int = 1, scheduler: str | None = None
) -> int:
    """Do `jobs` (see `open_jobs`); `on_done` is told name and verdict (or "failed: why") of each.

    Returns how many failed. `scheduler`: address of a dask.distributed scheduler; its workers must see the
    same files. ConfigError where it cannot be reached, distributed is not installed, or the folder of the
    answers cannot be written.
    """
    for folder in {Path(job.out) for job in jobs}:
        _make_writable(folder)
    if scheduler is not None:
        done = _on_cluster(jobs, scheduler)
    elif workers > 1 and len(jobs) > 1:
        done = _in_processes(jobs, workers)
    else:
        done = ((j, do_job(j)) for j in jobs)
    failed = 0
    with closing(done):
        for job, text in done:
            failed += text.startswith(FAILED)
            on_done(job.name, text)
    return failed


def _make_writable(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except (FileExistsError, NotADirectoryError) as error:
        raise ConfigError(f"{folder}: is no folder for answers, but a file or in one") from error
    except OSError as error:
        raise ConfigError(f"{folder}: cannot be made: {error.strerror}") from error
    if not os.access(folder, os.W_OK | os.X_OK):
        raise ConfigError(f"{folder}: answers cannot be written there: permission denied")


def do_job(job: Job) -> str:
    """Diagnose one job and keep the answer; returns the verdict, or "failed: why"."""
    try:
        made_of = job.inputs()
        rig = checked(load_any_rig(job.rig), job.rig)
        runs = [load_run(Path(p), rig) for p in job.runs]
        healthy = [load_run(Path(p), rig) for p in job.references]
        found = diagnose_any(runs, rig, references=healthy, without=job.without, seed=job.seed)
        said = msgspec.json.encode({**found.tables(), MADE_OF: made_of})
        write_whole(job.answer, msgspec.json.format(said, indent=2) + b"\n")
    except (HilError, ArithmeticError, ValueError, LookupError, OSError) as error:
        return _failed(job, error)
    job.failure.unlink(missing_ok=True)
    return found.verdict


def _failed(job: Job, error: BaseException) -> str:
    """Keep why a job failed, and say it."""
    with suppress(OSError):  # a full disk: then it is only said
        write_whole(job.failure, f"{type(error).__name__}: {error}\n")
    return f"{FAILED}{error}"


def summary(jobs: Sequence[Job]) -> list[dict[str, Any]]:
    """A row a job, from its file: name, verdict, effects, probability, shrink, or why it failed."""
    rows = []
    for job in jobs:
        row: dict[str, Any] = {"name": job.name, "verdict": "open", "effects": "", "probability": None,
                               "shrink": None}  # fmt: skip
        said = _kept(job)
        if said is not None and _why_open(job) is None:
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


def _in_processes(jobs: Sequence[Job], workers: int) -> Generator[tuple[Job, str], None, None]:
    with worker_pool(workers) as pool:
        under_way: dict[Future[str], Job] = {pool.submit(do_job, j): j for j in jobs}
        for future in as_completed(under_way):
            job = under_way[future]
            try:
                yield job, future.result()
            except BrokenProcessPool:
                died = RunError("its process died; start the batch again")
                yield job, _failed(job, died)


def _on_cluster(jobs: Sequence[Job], scheduler: str) -> Generator[tuple[Job, str], None, None]:
    try:
        from distributed import Client
        from distributed import as_completed as completed
    except ImportError as error:
        raise ConfigError("--scheduler needs dask.distributed: pip install 'hil[batch]'") from error
    try:
        client = Client(scheduler, timeout=CONNECT_S)  # type: ignore[no-untyped-call]
    except OSError as error:
        raise ConfigError(f"{scheduler}: no dask scheduler answers there: {error}") from error
    except ValueError as error:
        raise ConfigError(f"{scheduler}: is no tcp://HOST:PORT: {error}") from error
    with client:
        under_way = {client.submit(do_job, j, pure=False): j for j in jobs}
        for future in completed(list(under_way)):  # type: ignore[no-untyped-call]
            fault = future.exception()
            job = under_way[future]
            yield job, future.result() if fault is None else _failed(job, fault)
