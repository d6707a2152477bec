"""Where a ride and its model differ: by signal, frequency band, speed, load of the front wheel, and time."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hil.bicycle.checks import check_ride
from hil.bicycle.recorded import prepare
from hil.config import BicycleFile
from hil.errors import IdentificationError
from hil.gap.bicycle.noise import no_louder, ride_noise, tempered
from hil.gap.bicycle.nuisances import ride_nuisances
from hil.gap.bicycle.problem import RideProblem
from hil.gap.bicycle.rolled import rolled
from hil.gap.bicycle.roundness import once_a_turn
from hil.gap.bicycle.twin import LEAN_TORQUE
from hil.gap.bicycle.wheels import THIN, Wheels
from hil.gap.catalogue.nuisances import Nuisance
from hil.gap.floor.noise import projected
from hil.gap.located.cells import count_cells
from hil.gap.located.locate import located
from hil.gap.located.residual import refit
from hil.gap.located.result import Evidence, Located
from hil.gap.located.sanity import Finding
from hil.gap.record.regions import Codes
from hil.runs import Run

Array = NDArray[np.float64]

STILL_M_S = 0.5
ALONE: Final = Finding(
    "warning", "imu",
    "is not recorded: only the lean torque that nobody gives is judged; what moves no balance is unseen",
)  # fmt: skip
NARROW: Final = Finding(
    "info", "wheels",
    "roll as thin hard ones do, without the creep, the lag and the section of tyres, so that less is allowed "
    "for those",
)  # fmt: skip


def locate_rides(
    runs: Iterable[Run],
    rig: BicycleFile,
    *,
    nuisances: Sequence[Nuisance] | None = None,
    seed: int = 0,
    slopes: Sequence[Array] = (),
    slow: float = 0.0,
    wheels: Wheels | None = None,
) -> Located:
    """Locate the gap between rides and the bicycle's model, on roads of those slopes where they are given
    (`hil.gap.bicycle.road`), with `slow` of the sensors' noise besides as noise that lasts
    (`hil.gap.bicycle.noise`), on `wheels`, which they tell themselves by default (`hil.gap.bicycle.rolled`);
    IdentificationError where channels lie."""
    loaded = list(runs)
    rides = [prepare(run, rig) for run in loaded]
    findings = []
    for ride in rides:
        for f in (*ride.findings, *check_ride(ride)):
            if f.verdict == "fault":
                raise IdentificationError(f"{ride.name}: {f.subject}: {f.text}")
            is_warning = f.verdict == "warning"
            findings.append(Finding("warning" if is_warning else "info", f.subject, f.text))
    problem = RideProblem(rig, rides, slopes, wheels or rolled(rides, rig, seed))
    if problem.wheels is THIN:
        findings.append(NARROW)
    if problem.signals == (LEAN_TORQUE,):
        findings.append(ALONE)
    if (beats := once_a_turn(rides)) is not None:
        findings.append(Finding("warning", "wheel", beats))
    chosen = nuisances or ride_nuisances(rig, problem)
    rng = np.random.default_rng(seed)
    noise = ride_noise(problem, problem.base, rng, slow)
    best = refit(problem, noise, chosen)
    noise = no_louder(noise, problem, best.residual)
    best = refit(problem, noise, chosen)
    noise = tempered(noise, problem, best.residual)
    noise = projected(noise, problem, best.jacobian, best.prior_sd)
    motion = problem.motion(best.vector)
    cells = count_cells(
        problem, noise, noise.tamed(problem, best.residual), _codes(problem, motion)
    )
    evidence = Evidence(
        problem, noise, best.vector, best.residual, best.jacobian, tuple(motion), cells
    )
    names = tuple(run.path.name for run in loaded)
    return located(problem.rig, names, evidence, best, findings, rng)


def _codes(problem: RideProblem, motion: Sequence[Mapping[str, Array]]) -> list[dict[str, Codes]]:
    """For each series, by dimension, the region of each of its samples."""
    out = []
    for x in problem.series:
        m = motion[x.stretch]
        fast = 0.5 * float(np.quantile(m["speed"], 0.95))
        speed = np.where(m["speed"] < STILL_M_S, 1, np.where(m["speed"] < fast, 2, 3))
        load = (m["front"] > np.median(m["front"])).astype(np.int64)
        t = problem.t_s[x.part]
        time = np.minimum((3.0 * (t - t[0]) / max(t[-1] - t[0], 1e-9)).astype(np.int64), 2)
        out.append({"speed": speed.astype(np.int64), "load": load, "time": time})
    return out
