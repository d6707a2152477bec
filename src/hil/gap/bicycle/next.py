"""Which manoeuvre next: the one of the catalogue whose ride would best split the candidates that are left.

No rig moves: what comes out is a sentence for the rider, and simulated rides, one a candidate, to hold the
real one against. Each manoeuvre is ridden once by the simulated rider; the twin with each candidate answers
that ride, and what the others and the nuisances cannot make up for tells them apart, as in `hil.gap.next`,
where it stands above noise and what a healthy bicycle is off its file by.
"""

from __future__ import annotations

import shutil
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import pandas as pd
import tomlkit
from numpy.typing import NDArray

from hil.bicycle.manoeuvres import MANOEUVRES, Manoeuvre
from hil.bicycle.recorded import prepare
from hil.bicycle.simulated import save
from hil.blas import one_blas_thread
from hil.config import BicycleFile
from hil.errors import IdentificationError, KinematicsError, RunError
from hil.files import write_whole
from hil.gap.bicycle.locate import NARROW
from hil.gap.bicycle.noise import ride_noise, tempered, with_tolerances
from hil.gap.bicycle.nuisances import ride_nuisances
from hil.gap.bicycle.problem import RideProblem
from hil.gap.bicycle.wheels import THIN, TYRES, Wheels
from hil.gap.catalogue.nuisances import Nuisance
from hil.gap.floor.noise import NoiseModel
from hil.gap.next.candidates import Candidate, read_candidates, vector_of
from hil.gap.next.score import Split, split_between
from hil.runs import Run, RunMeta
from hil.runs.table import check_table

Array = NDArray[np.float64]

USUAL: Final = "u-turns"
"""What one rides who asks nothing in particular."""


@dataclass(frozen=True, slots=True)
class RideProposal:
    """The manoeuvre to ride, and what it is expected to tell."""

    manoeuvre: Manoeuvre
    duration_s: float
    split: Split
    usual: Split | None
    """What the ride that one would take anyway tells."""
    candidates: tuple[Candidate, ...]
    tried: int
    rig: BicycleFile

    @property
    def sentence(self) -> str:
        """What to ride, what it splits, what to expect."""
        names = [c.name for c in self.candidates]
        pairs = [f"{names[a]} from {names[b]}" for a, b in self.split.apart()]
        if not pairs:
            return (
                f"No manoeuvre splits {', '.join(names)} with these sensors; the best of {self.tried} is "
                f"{self.manoeuvre.name}. Another sensor is needed."
            )
        usual = (
            ""
            if self.usual is None
            else f" ({USUAL.replace('-', ' ')}: {100.0 * self.usual.right:.0f} %)"
        )
        text = self.manoeuvre.instruction
        return (
            f"{text[0].upper()}{text[1:]} ({self.manoeuvre.name}, {self.duration_s:.0f} s): it tells "
            f"{'; '.join(pairs)}. Expected probability of the true one after it: "
            f"{100.0 * self.split.right:.0f} %{usual}."
        )

    def table(self) -> dict[str, Any]:
        """The diagnosis file's `next_experiment`."""
        names = [c.name for c in self.candidates]
        return {
            "sentence": self.sentence, "kind": "ride", "motion": self.manoeuvre.name,
            "instruction": self.manoeuvre.instruction, "duration_s": self.duration_s, "payload": None,
            "candidates": names,
            "splits": [[names[a], names[b]] for a, b in self.split.apart()],
            "expected_probability": self.split.right, "expected_entropy": self.split.entropy,
            "generic_probability": None if self.usual is None else self.usual.right,
            "tried": self.tried,
        }  # fmt: skip


@one_blas_thread()
def propose_ride(
    tables: Mapping[str, Any],
    rig: BicycleFile,
    *,
    seed: int = 0,
    report: Callable[[str], None] | None = None,
    manoeuvres: Sequence[Manoeuvre] = MANOEUVRES,
) -> RideProposal:
    """The best of `manoeuvres` for the candidates of a ride's diagnosis (format hil-diagnosis/1).

    IdentificationError where fewer than two candidates are left, or none can be ridden.
    """
    say = report or (lambda _: None)
    candidates, shared = read_candidates(tables, rig)
    signals = tuple(tables["gap"]["signals"])
    wheels = _wheels(tables)
    found: list[tuple[float, Manoeuvre, float, Split]] = []
    for m in manoeuvres:
        say(f"{m.name}: {m.instruction}")
        try:
            problem = _ridden(m, rig, wheels, signals, seed)
        except KinematicsError:  # this bicycle falls
            continue
        vectors = [vector_of(c, shared, problem.base, problem.table) for c in candidates]
        answers = problem.answers(np.array(vectors))
        if not np.all(np.isfinite(answers)):
            continue
        nuisances = ride_nuisances(rig, problem)
        noise = _noise(problem, nuisances, vectors[0], answers[0], np.random.default_rng(seed))
        split = split_between(problem, noise, nuisances, candidates, vectors, answers)
        first, last = problem.pieces[0].span_s
        found.append((split.entropy, m, last - first, split))
    if not found:
        raise IdentificationError(f"{rig.name}: none of the manoeuvres can be ridden")
    _, best, duration_s, split = min(found, key=lambda x: x[0])
    usual = next((s for _, m, _, s in found if m.name == USUAL), None)
    return RideProposal(best, duration_s, split, usual, tuple(candidates), len(found), rig)


def _wheels(tables: Mapping[str, Any]) -> Wheels:
    """The sort of wheels that a diagnosis found its rides were ridden on."""
    is_thin = any(f["subject"] == NARROW.subject for f in tables.get("findings", ()))
    return THIN if is_thin else TYRES


def _ridden(
    m: Manoeuvre, rig: BicycleFile, wheels: Wheels, signals: Sequence[str], seed: int
) -> RideProblem:
    ride = m.ride(rig, seed)
    kept = [c for c in ride.table.columns if not str(c).startswith("imu.") or c in signals]
    table = check_table(ride.table[kept], m.name, rig)
    run = Run(Path(m.name), RunMeta(rig=rig.name, mode="ride"), None, table, pd.DataFrame({"t": []}),
              (), None, rig)  # fmt: skip
    return RideProblem(rig, [prepare(run, rig)], wheels=wheels)


def _noise(
    problem: RideProblem, nuisances: Sequence[Nuisance], vector: Array, answer: Array,
    rng: np.random.Generator,
) -> NoiseModel:  # fmt: skip
    """The floor as the diagnosis of a gap weighs candidates: beside what the best of them leaves, which is
    noise again, and what a healthy bicycle is off its file by. `answer` (N,) is the twin's at `vector`."""
    noise = ride_noise(problem, vector, rng)
    jacobian = problem.jacobian([n.name for n in nuisances], vector, answer)
    sd = np.array([n.sd for n in nuisances])
    drawn = with_tolerances(noise, problem, vector, jacobian, sd, rng).draws
    return tempered(noise, problem, np.sqrt(np.mean(drawn**2, axis=0)), 1.0)


def write_ride_proposal(path: Path, proposal: RideProposal, seed: int = 0) -> list[Path]:
    """Write the instruction to `path` (TOML) and beside it a simulated ride for each candidate.

    Returns the run folders. RunError where the disk refuses or one of them is there already; then there is
    none of them.
    """
    if path.exists():
        raise RunError(f"{path}: exists already; a proposal never overwrites")
    m, folders = proposal.manoeuvre, ride_folders(path, proposal.candidates)
    rides = [m.ride(_with(proposal.rig, c), seed) for c in proposal.candidates]
    written: list[Path] = []
    try:
        for ride, folder, c in zip(rides, folders, proposal.candidates, strict=True):
            written.append(save(ride, folder, f"simulated: {m.name} with {c.name}"))
        _write_instruction(path, proposal, folders)
    except BaseException:
        for folder in written:
            shutil.rmtree(folder, ignore_errors=True)
        raise
    return folders


def ride_folders(path: Path, candidates: Sequence[Candidate]) -> list[Path]:
    """Where the simulated ride of each candidate goes, beside the instruction at `path`.

    RunError where that is no .toml.
    """
    if path.suffix != ".toml":
        raise RunError(f"{path}: an instruction is a .toml file, with simulated rides beside it")
    names = (f"{path.stem}_{c.location}_{c.effect}".replace(".", "_") for c in candidates)
    return [path.with_name(name) for name in names]


def _write_instruction(path: Path, proposal: RideProposal, folders: Sequence[Path]) -> None:
    doc = tomlkit.document()
    doc.add(tomlkit.comment("What to ride next, by hil gap next."))
    m = proposal.manoeuvre
    doc.update(
        {
            "sentence": proposal.sentence, "rig": proposal.rig.name, "manoeuvre": m.name,
            "instruction": m.instruction, "cruise": m.cruise, "turning": m.turning, "vigour": m.vigour,
        }
    )  # fmt: skip
    doc["simulated"] = {c.name: f.name for c, f in zip(proposal.candidates, folders, strict=True)}
    try:
        write_whole(path, tomlkit.dumps(doc))
    except OSError as error:
        raise RunError(f"{path}: cannot be written: {error.strerror}") from error


def _with(rig: BicycleFile, c: Candidate) -> BicycleFile:
    """The bicycle with a candidate's effect instead of its file's own of that name."""
    tables = rig.model_dump()
    others = [
        e for e in tables["effects"] if (e["effect"], e["location"]) != (c.effect, c.location)
    ]
    parameters = {name.rpartition(".")[2]: value for name, value in c.values.items()}
    mine = {"effect": c.effect, "location": c.location, "parameters": parameters}
    return BicycleFile.model_validate({**tables, "effects": [*others, mine]})
