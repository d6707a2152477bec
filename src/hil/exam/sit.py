"""Cases sat one by one: each diagnosis a file, each failure a file, so that nothing is lost or done twice."""

from __future__ import annotations

import json
import signal
import time
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import closing, contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import FrameType
from typing import Any, Final, Literal

import numpy as np

from hil import __version__
from hil.blas import one_blas_thread
from hil.configfile import load_any_rig
from hil.effectlines import effect_names
from hil.errors import ConfigError, HilError, RunError
from hil.exam.case import ANSWER, Case, case_folders, load_case, name_pattern, read_answer, seals_of
from hil.exam.rigs import ALL
from hil.files import write_whole
from hil.workers import worker_pool

Baseline = Literal["random", "best-training", "naive-bic", "oracle"]
LIMIT_S: Final = 1800.0
AGAIN_S: Final = 1.0
"""After which the limit is told again."""


@dataclass(frozen=True, slots=True)
class Sitting:
    """How cases are sat."""

    out: Path
    baseline: Baseline | None = None
    answers: Path | None = None
    """Where a baseline that knows, or an exam that withholds, reads the effect. No diagnosis ever does."""
    without: Literal["auto"] | tuple[str, ...] = ()
    """Effects withheld from the diagnosis; "auto": each case's own."""
    limit_s: float = LIMIT_S

    @property
    def sat_by(self) -> str:
        """Who sits, as each diagnosis says."""
        return self.baseline or "diagnose"

    def file(self, case: str) -> Path:
        """Where the diagnosis of a case is kept."""
        return self.out / f"{case}.json"


def sit_exam(
    cases: Path,
    sitting: Sitting,
    *,
    only: str = "",
    jobs: int = 2,
    on_done: Callable[[str, str], None] = lambda case, text: None,
    on_count: Callable[[int, int], None] = lambda todo, there: None,
) -> None:
    """Diagnose every case below `cases` whose name matches `only`; those that have a diagnosis are left.

    A case that fails, or whose process dies, gets a diagnosis with the verdict "error" and the reason; a
    sitting that is interrupted goes on where it stopped. A file that is no diagnosis does not count.
    ConfigError where a diagnosis that is there was sat by another, or knowing other effects.
    """
    pattern = name_pattern(only)
    folders = [f for f in case_folders(cases) if pattern.search(f.name)]
    if not folders:
        raise RunError(f"{cases}: holds no case whose name matches {only!r}")
    if (sitting.baseline == "oracle" or sitting.without == "auto") and sitting.answers is None:
        raise ConfigError(
            "an oracle, and an exam that withholds effects, need the answers: --answers"
        )
    if sitting.answers is not None and not sitting.answers.is_dir():
        raise RunError(f"{sitting.answers}: no such folder")
    if sitting.without != "auto":
        _check_effects(sitting.without)
    sitting.out.mkdir(parents=True, exist_ok=True)
    kept = {f: _kept(sitting.file(f.name)) for f in folders}
    foreign = [why for f, said in kept.items() if said and (why := _foreign(f, said, sitting))]
    if foreign:
        raise ConfigError(
            "\n".join(foreign)
            + "\nname another folder with --out, or delete those files to sit them again"
        )
    todo = [f for f, said in kept.items() if said is None]
    again = {f for f in todo if sitting.file(f.name).is_file()}
    on_count(len(todo), len(folders) - len(todo))
    with closing(_sat(todo, sitting, jobs)) as sat:
        for folder, text in sat:
            told = f"{text} (sat again: its file was no diagnosis)" if folder in again else text
            on_done(folder.name, told)


def _kept(file: Path) -> dict[str, Any] | None:
    """The diagnosis in a file; None where there is none."""
    try:
        said = json.loads(file.read_text(encoding="utf-8"))
    except (FileNotFoundError, ValueError):
        return None
    except OSError as error:
        raise RunError(f"{file}: cannot be read: {error.strerror}") from error
    return said if isinstance(said, dict) and "verdict" in said else None


def _foreign(folder: Path, said: dict[str, Any], sitting: Sitting) -> str:
    """Why the diagnosis that is kept is not one of this sitting; "" where it is, or does not say."""
    note = said.get("exam")
    note = note if isinstance(note, dict) else {}
    file = sitting.file(folder.name)
    by = note.get("sat_by", sitting.sat_by)
    if by != sitting.sat_by:
        return f"{file}: was sat by {by}, not by {sitting.sat_by}"
    if "without" not in note:
        return ""
    try:
        without = _withheld(folder, sitting)
    except HilError:  # sitting the case says so
        return ""
    if set(note["without"]) != set(without):
        known, asked = (", ".join(sorted(w)) or "nothing" for w in (note["without"], without))
        return f"{file}: was sat with {known} withheld, not {asked}"
    return ""


def _sat(
    folders: Sequence[Path], sitting: Sitting, jobs: int
) -> Generator[tuple[Path, str], None, None]:
    if jobs > 1:
        yield from _in_processes(folders, sitting, jobs)
        return
    for folder in folders:
        yield folder, sit_case(folder, sitting)


def _check_effects(names: Sequence[str]) -> None:
    """ConfigError where one of `names` is no effect of any rig's model: nothing would be withheld."""
    known = {e for rig in ALL for e in effect_names(load_any_rig(rig))} if names else set()
    strange = [name for name in names if name not in known]
    if strange:
        raise ConfigError(
            f"no effect {', '.join(strange)} that could be withheld; there are {', '.join(sorted(known))}"
        )


def sit_case(folder: Path, sitting: Sitting) -> str:
    """Diagnose one case and write the file; returns a line about it."""
    started_s = time.perf_counter()
    note: dict[str, Any] = {"sat_by": sitting.sat_by, "hil": __version__}
    try:
        case = load_case(folder)
        note["seals"] = sorted(seals_of(folder))
        note["recorded_s"] = round(sum(r.duration_s for r in (*case.runs, *case.references)), 3)
        without = _withheld(folder, sitting)
        note["without"] = list(without)
        started_s = time.perf_counter()
        with _limit(sitting.limit_s):
            said = _answered(case, sitting, without)
    except (
        HilError,
        ArithmeticError,
        ValueError,
        LookupError,
        TimeoutError,
        np.linalg.LinAlgError,
    ) as error:
        said = _failed(f"{type(error).__name__}: {error}")
    took_s = time.perf_counter() - started_s
    _write(folder.name, sitting, said, {**note, "seconds": round(took_s, 3)})
    return f"{said['verdict']} in {took_s:.1f} s"


@one_blas_thread()
def _answered(case: Case, sitting: Sitting, without: Sequence[str]) -> dict[str, Any]:
    if sitting.baseline is not None:
        from hil.exam.baselines import sit_baseline

        answer = None
        if sitting.baseline == "oracle" and sitting.answers is not None:
            answer = read_answer(sitting.answers / case.id / ANSWER)
        return sit_baseline(sitting.baseline, case, answer)
    from hil.gap.bicycle import diagnose_any

    known = [e for e in effect_names(case.rig) if e in without]  # others it could not name anyway
    found = diagnose_any(case.runs, case.rig, references=case.references, without=known)
    return dict(found.tables())


def _withheld(folder: Path, sitting: Sitting) -> tuple[str, ...]:
    if sitting.without != "auto":
        return tuple(sitting.without)
    assert sitting.answers is not None
    answer = read_answer(sitting.answers / folder.name / ANSWER)
    return tuple(dict.fromkeys(e["effect"] for e in answer["effects"]))


def _failed(why: str) -> dict[str, Any]:
    return {
        "format": "hil-diagnosis/1",
        "verdict": "error",
        "error": why,
        "causes": [],
        "effects": [],
    }


def _write(case: str, sitting: Sitting, said: dict[str, Any], note: dict[str, Any]) -> None:
    text = json.dumps({**said, "exam": note}, indent=1, ensure_ascii=False, default=_plain)
    file = sitting.file(case)
    try:
        write_whole(file, text + "\n")
    except OSError as error:
        raise RunError(f"{file}: cannot be written: {error.strerror}") from error


def _plain(value: Any) -> Any:
    if isinstance(value, np.generic):
        return value.item()
    raise TypeError(f"{type(value).__name__} does not go into JSON")


@contextmanager
def _limit(seconds: float) -> Iterator[None]:
    """TimeoutError after so long, where the process can be told so (its main thread), and again and again:
    one that is raised while memory is collected, or in a callback of compiled code, is lost."""

    def ring(number: int, frame: FrameType | None) -> None:
        raise TimeoutError(f"took longer than {seconds:g} s")

    before = signal.signal(signal.SIGALRM, ring)
    signal.setitimer(signal.ITIMER_REAL, seconds, AGAIN_S)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)


def _in_processes(
    folders: Sequence[Path], sitting: Sitting, jobs: int
) -> Generator[tuple[Path, str], None, None]:
    """Sit cases in several processes. Where one dies, those that were under way are tried again alone."""
    suspects: list[Path] = []
    queue = list(folders)
    while queue:
        queue, died = yield from _until_broken(queue, sitting, jobs)
        suspects += died
    for folder in suspects:
        _, died = yield from _until_broken([folder], sitting, 1)
        if died:
            _write(
                folder.name,
                sitting,
                _failed("its process died"),
                {"sat_by": sitting.sat_by},
            )
            yield folder, "error: its process died"


def _until_broken(
    folders: list[Path], sitting: Sitting, jobs: int
) -> Generator[tuple[Path, str], None, tuple[list[Path], list[Path]]]:
    """Yields what is done; returns those not begun and those under way when a process died."""
    queue = list(folders)
    with worker_pool(jobs) as pool:
        under_way: dict[Future[str], Path] = {}
        try:
            while queue or under_way:
                while queue and len(under_way) < jobs:
                    folder = queue.pop(0)
                    under_way[pool.submit(sit_case, folder, sitting)] = folder
                done, _ = wait(under_way, return_when=FIRST_COMPLETED)
                for future in done:
                    text = future.result()
                    yield under_way.pop(future), text
        except BrokenProcessPool:
            return queue, [f for f in under_way.values() if not sitting.file(f.name).is_file()]
    return [], []
